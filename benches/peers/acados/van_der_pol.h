/* The oscillator of configs/van-der-pol. */
static inline void rates(const double *x, const double *u, double s[NX][PADDED], double *f,
                         double df[NX][PADDED]) {
    const double a = -2 * x[0] * x[1] - 1, b = 1 - x[0] * x[0];
    f[0] = x[1];
    f[1] = b * x[1] - x[0] + u[0];
    for (int j = 0; j < PADDED; j++) {
        df[0][j] = s[1][j];
        df[1][j] = a * s[0][j] + b * s[1][j];
    }
    df[1][NX] += 1;
}
