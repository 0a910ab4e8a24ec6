
/* The states after a step, from a group on. */
static void pinc_advance(pinc_vector z[PINC_GROUPS][PINC_ROW], int first)
{
    int substep;
    int g;
    for (substep = 0; substep < @SUBSTEPS@; substep++) {
        for (g = first; g < PINC_GROUPS; g++) {
            pinc_vector *x = z[g];
            const pinc_vector *u = z[g] + PINC_NX;
            pinc_vector slopes[@STAGES@][PINC_NX];
            pinc_vector stage[PINC_NX];
@STEPS@
        }
    }
}
