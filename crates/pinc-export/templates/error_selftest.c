
@ERROR_TABLES@
/* How far estimated errors are from golden ones, in parts of what is allowed: 1e-9 of the largest of
   a case in double, and the rounding of states and rates. */
static double pinc_error_off(void)
{
    const int is_float = (sizeof(PINC_REAL) == sizeof(float)) ? 1 : 0;
    double worst = 0.0;
    int c;
    int i;
    for (c = 0; c < @CASES@; c++) {
        PINC_REAL x[PINC_NX];
        PINC_REAL u[@WIDTH@];
        PINC_REAL error[PINC_NX];
        double largest = 0.0;
        double size = 1.0;
        for (i = 0; i < PINC_NX; i++) {
            const double expected = fabs(pinc_error_of[c][i]);
            x[i] = PINC_N(pinc_error_x[c][i]);
            size = (fabs(pinc_error_x[c][i]) > size) ? fabs(pinc_error_x[c][i]) : size;
            largest = (expected > largest) ? expected : largest;
        }
        for (i = 0; i < @WIDTH@; i++) {
            u[i] = PINC_N(pinc_error_u[c][i]);
        }
        pinc_error(x, u, error);
        for (i = 0; i < PINC_NX; i++) {
            const double allowed = (is_float != 0) ? (1e-3 * (largest + size))
                                                   : ((1e-9 * largest) + (1e-13 * size));
            const double off = fabs((double)error[i] - pinc_error_of[c][i]) / allowed;
            if (!(off <= worst)) {
                worst = (off > worst) ? off : 2.0;
            }
        }
    }
    return worst;
}
