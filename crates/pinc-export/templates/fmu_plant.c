/* Value references: states, then outputs that are no states, derivatives, inputs, and initial states. */
#define PINC_INPUTS @INPUTS@

/* The longest substep, in s. */
#define PINC_FINE_S @FINE@

static int pinc_begin_run(pinc_slave *s)
{
    memcpy(s->reals, s->reals + (PINC_INPUTS + PINC_NU), PINC_NX * sizeof(double));
    return 0;
}

static void pinc_refresh(pinc_slave *s)
{
@REFRESH@}

static void pinc_changed(pinc_slave *s)
{
    (void)s;
}

/* A substep of the classical Runge-Kutta method, of order 4. */
static void pinc_substep(double *x, const double *u, double h)
{
    static const double reach[4] = {0.5, 0.5, 1.0, 0.0};
    static const double weight[4] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
    double begin[PINC_NX];
    double stage[PINC_NX];
    double k[PINC_NX];
    int j;
    int i;
    memcpy(begin, x, sizeof(begin));
    memcpy(stage, x, sizeof(stage));
    for (j = 0; j < 4; j++) {
        pinc_@RK@_derivative(stage, u, k);
        for (i = 0; i < PINC_NX; i++) {
            stage[i] = begin[i] + (h * reach[j] * k[i]);
            x[i] += h * weight[j] * k[i];
        }
    }
}

/* Goes on by a communication step; 0 if that is possible. */
static int pinc_advance(pinc_slave *s, double from, double length)
{
    const double parts = ceil((length / PINC_FINE_S) - 1e-9);
    const double count = (parts > 1.0) ? parts : 1.0;
    double done;
    int i;
    for (done = 0.0; done < count - 0.5; done += 1.0) {
        pinc_substep(s->reals, s->reals + PINC_INPUTS, length / count);
    }
    for (i = 0; i < PINC_NX; i++) {
        const double difference = s->reals[i] - s->reals[i];
        if (!(difference <= 0.0)) {
            /* The equations have no value there. */
            return 1;
        }
    }
    s->time = from + length;
    return 0;
}
