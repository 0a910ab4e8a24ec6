/* ---- What slaves of all versions have ------------------------------------------------------- */

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@SetDebugLogging)(@INSTANCE@ c, @FMI@Boolean on, size_t n,
                                                     const @FMI@String categories[])
{
    (void)c;
    (void)on;
    (void)n;
    (void)categories;
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@ExitInitializationMode)(@INSTANCE@ c)
{
    if (pinc_begin_run(pinc_of(c)) == 0) {
        return @FMI@OK;
    }
    pinc_say(c, "an input before the first sample (_start) is not a number within its bounds");
    return @FMI@Error;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Terminate)(@INSTANCE@ c)
{
    (void)c;
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Reset)(@INSTANCE@ c)
{
    pinc_set_defaults(pinc_of(c));
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Set@STATE@)(@INSTANCE@ c, @FMI@@STATE@ state)
{
    memcpy(pinc_of(c), state, sizeof(pinc_slave));
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Serialized@STATE@Size)(@INSTANCE@ c, @FMI@@STATE@ state,
                                                            size_t *size)
{
    (void)c;
    (void)state;
    *size = sizeof(pinc_slave);
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Serialize@STATE@)(@INSTANCE@ c, @FMI@@STATE@ state,
                                                       @FMI@Byte bytes[], size_t size)
{
    (void)c;
    if (size != sizeof(pinc_slave)) {
        return @FMI@Error;
    }
    memcpy(bytes, state, size);
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Get@STATE@)(@INSTANCE@ c, @FMI@@STATE@ *state)
{
    if (*state == NULL) {
        *state = malloc(sizeof(pinc_slave));
    }
    if (*state == NULL) {
        return @FMI@Error;
    }
    memcpy(*state, pinc_of(c), sizeof(pinc_slave));
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Free@STATE@)(@INSTANCE@ c, @FMI@@STATE@ *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@@DESERIALIZE@@STATE@)(@INSTANCE@ c, const @FMI@Byte bytes[],
                                                         size_t size, @FMI@@STATE@ *state)
{
    if (size != sizeof(pinc_slave)) {
        return @FMI@Error;
    }
    if (PINC_FMI(@FMI@Get@STATE@)(c, state) != @FMI@OK) {
        return @FMI@Error;
    }
    memcpy(*state, bytes, size);
    return @FMI@OK;
}

PINC_EXPORT void PINC_FMI(@FMI@FreeInstance)(@INSTANCE@ c)
{
    free(c);
}

