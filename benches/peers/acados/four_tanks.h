/* The four tanks of configs/four-tanks. */
#include <math.h>

static inline void rates(const double *x, const double *u, double s[NX][PADDED], double *f,
                         double df[NX][PADDED]) {
    static const double outlet[] = {0.071, 0.057, 0.071, 0.057};
    static const double area[] = {28.0, 32.0, 28.0, 32.0};
    static const double gamma = 0.5, k1 = 3.33, k2 = 3.35;
    double out[NX], slope[NX];
    for (int i = 0; i < NX; i++) {
        const double root = sqrt(2 * 981.0 * x[i]);
        out[i] = outlet[i] * root;
        slope[i] = outlet[i] * 981.0 / root;
    }
    f[0] = (gamma * k1 * u[0] + out[2] - out[0]) / area[0];
    f[1] = (gamma * k2 * u[1] + out[3] - out[1]) / area[1];
    f[2] = ((1 - gamma) * k2 * u[1] - out[2]) / area[2];
    f[3] = ((1 - gamma) * k1 * u[0] - out[3]) / area[3];
    for (int j = 0; j < PADDED; j++) {
        df[0][j] = (slope[2] * s[2][j] - slope[0] * s[0][j]) / area[0];
        df[1][j] = (slope[3] * s[3][j] - slope[1] * s[1][j]) / area[1];
        df[2][j] = -slope[2] * s[2][j] / area[2];
        df[3][j] = -slope[3] * s[3][j] / area[3];
    }
    df[0][NX] += gamma * k1 / area[0];
    df[1][NX + 1] += gamma * k2 / area[1];
    df[2][NX + 1] += (1 - gamma) * k2 / area[2];
    df[3][NX] += (1 - gamma) * k1 / area[3];
}
