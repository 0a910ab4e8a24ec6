
/* The outputs, from a group on. */
static void pinc_outputs_of(pinc_vector z[PINC_GROUPS][PINC_ROW], int first)
{
    int g;
    for (g = first; g < PINC_GROUPS; g++) {
        pinc_outputs_at(z[g], z[g] + PINC_NX, z[g] + PINC_NX + PINC_NU);
    }
}
