
/* The states after a step. */
static void pinc_advance(pinc_vector z[PINC_GROUPS][PINC_ROW])
{
    int substep;
    int g;
    for (substep = 0; substep < @SUBSTEPS@; substep++) {
        for (g = 0; g < PINC_GROUPS; g++) {
            pinc_vector *x = z[g];
            const pinc_vector *u = z[g] + PINC_NX;
            pinc_vector slopes[@STAGES@][PINC_NX];
            pinc_vector stage[PINC_NX];
@STEPS@
        }
    }
}
