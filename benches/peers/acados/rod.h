/* The heated rod of configs/distributed/rod.toml, with NX volumes. */
static inline void rates(const double *x, const double *u, double s[NX][PADDED], double *f,
                         double df[NX][PADDED]) {
    static const double pi = 3.14159265358979323846, length = 0.2, diameter = 0.02;
    static const double conductivity = 50.0, density = 7800.0, heat_capacity = 480.0;
    static const double air = 10.0, clamp = 200.0, emissivity = 0.8, sigma = 5.670374419e-8;
    static const double ambient = 20.0, kelvin = 273.15;
    const double dz = length / NX, area = pi * diameter * diameter / 4;
    const double along = conductivity * area / dz, surface = pi * diameter * dz;
    const double capacity = density * heat_capacity * area * dz, end = clamp * area;
    const double a = ambient + kelvin, a4 = a * a * a * a;
    for (int i = 0; i < NX; i++) {
        const double before = i > 0 ? along : 0, after = i + 1 < NX ? along : end;
        const double t = x[i] + kelvin, t3 = t * t * t;
        const double loss = surface * (air * (x[i] - ambient) + emissivity * sigma * (t3 * t - a4));
        const double in = i > 0 ? along * (x[i - 1] - x[i]) : u[0];
        const double out = i + 1 < NX ? along * (x[i] - x[i + 1]) : end * (x[i] - ambient);
        const double own = before + after + surface * (air + 4 * emissivity * sigma * t3);
        f[i] = (in - out - loss) / capacity;
        for (int j = 0; j < PADDED; j++) {
            const double left = i > 0 ? along * s[i - 1][j] : 0;
            const double right = i + 1 < NX ? along * s[i + 1][j] : 0;
            df[i][j] = (left + right - own * s[i][j]) / capacity;
        }
    }
    df[0][NX] += 1 / capacity;
}
