/* Value references: states, then outputs that are no states, derivatives, inputs, and initial states. */
#define PINC_INPUTS @INPUTS@

/* The longest substep, in s, and how often it may be halved. */
#define PINC_FINE_S @FINE@
#define PINC_HALVINGS @HALVINGS@

/* Notes how large each state has been. */
static void pinc_compare(pinc_slave *s)
{
    int i;
    for (i = 0; i < PINC_NX; i++) {
        s->largest[i] = (fabs(s->reals[i]) > s->largest[i]) ? fabs(s->reals[i]) : s->largest[i];
    }
}

static int pinc_begin_run(pinc_slave *s)
{
    memcpy(s->reals, s->reals + (PINC_INPUTS + PINC_NU), PINC_NX * sizeof(double));
    memset(s->largest, 0, sizeof(s->largest));
    pinc_compare(s);
    return 1 - pinc_are_finite(s->reals, PINC_NX);
}

static void pinc_refresh(pinc_slave *s)
{
@REFRESH@}

static void pinc_changed(pinc_slave *s)
{
    (void)s;
}

/* A substep of the classical Runge-Kutta method, of order 4; adds to `way` how far each state moves. */
static void pinc_substep(double *x, const double *u, double h, double *way)
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
            way[i] += (j == 0) ? fabs(h * k[i]) : 0.0;
            stage[i] = begin[i] + (h * reach[j] * k[i]);
            x[i] += h * weight[j] * k[i];
        }
    }
}

/* Integrates from the state at `from` to `to` in equal substeps. */
static void pinc_integrate(const double *from, const double *u, double length, double substeps,
                           double *to, double *way)
{
    double done;
    memset(way, 0, PINC_NX * sizeof(double));
    memcpy(to, from, PINC_NX * sizeof(double));
    for (done = 0.0; done < substeps - 0.5; done += 1.0) {
        pinc_substep(to, u, length / substeps, way);
    }
}

/* Moves x on by T at most, in so short substeps that half as many give the same; 0 if there are such.
   `largest` is how large each state has been. */
static int pinc_settle(double *x, const double *u, double length, const double *largest)
{
    const double half = ceil((0.5 * length / PINC_FINE_S) - 1e-9);
    double substeps = (half > 1.0) ? half : 1.0;
    double coarse[PINC_NX];
    double fine[PINC_NX];
    double way[PINC_NX];
    int agree = 0;
    int halvings;
    int i;
    pinc_integrate(x, u, length, substeps, coarse, way);
    for (halvings = 0; (halvings <= PINC_HALVINGS) && (agree == 0); halvings++) {
        substeps *= 2.0;
        pinc_integrate(x, u, length, substeps, fine, way);
        agree = pinc_are_finite(fine, PINC_NX);
        for (i = 0; i < PINC_NX; i++) {
            const double most = (1e-3 * (fabs(x[i]) + way[i])) + (1e-6 * largest[i]);
            agree &= (fabs(fine[i] - coarse[i]) <= most) ? 1 : 0;
        }
        memcpy(coarse, fine, sizeof(coarse));
    }
    memcpy(x, fine, sizeof(fine));
    return 1 - agree;
}

/* Goes on by a communication step; 0 if that is possible, and all is as before if not. */
static int pinc_advance(pinc_slave *s, double from, double length)
{
    const double parts = ceil((length / PINC_SAMPLE_TIME_S) - 1e-9);
    const double count = (parts > 1.0) ? parts : 1.0;
    double x[PINC_NX];
    double done;
    memcpy(x, s->reals, sizeof(x));
    for (done = 0.0; done < count - 0.5; done += 1.0) {
        if (pinc_settle(x, s->reals + PINC_INPUTS, length / count, s->largest) != 0) {
            return 1;
        }
    }
    memcpy(s->reals, x, sizeof(x));
    pinc_compare(s);
    s->time = from + length;
    return 0;
}
