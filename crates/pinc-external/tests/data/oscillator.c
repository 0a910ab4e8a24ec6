/* An oscillator as an FMU for model exchange and for co-simulation, of FMI 2.0 and of FMI 3.0:
   x1' = x2, x2' = k (1 - x1^2) x2 - x1 + u + t0, with t0 the time at which it begins, and with the
   output y = x1 x2 + 2 u, which exists after initialization. In version 3, x and w are arrays of two, and u is w[2]. Derivatives
   in k exist during initialization only, as the standard says of a fixed parameter; derivatives at
   states with x1 > 9 fail. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { X = 1, RATE = 3, K = 5, U = 6, Y = 7 }; /* x1 is 1, x2 is 2; in version 3 an array is one reference */
enum { START, INITIALIZATION, EVENT, CONTINUOUS };
enum { OK = 0, ERROR = 3 };

typedef struct {
    int mode;
    double x[2], k, w[2], begin;
} Oscillator;

static void *instance(void)
{
    Oscillator *o = calloc(1, sizeof *o);
    if (o) o->k = 1;
    return o;
}

static double *place(Oscillator *o, int arrays, unsigned reference, size_t *size)
{
    *size = arrays && reference != K ? 2 : 1;
    if (arrays) return reference == X ? o->x : reference == U ? o->w : reference == K ? &o->k : NULL;
    return reference == X || reference == X + 1 ? &o->x[reference - X]
        : reference == U ? &o->w[1] : reference == K ? &o->k : NULL;
}

static int copy(Oscillator *o, int arrays, const unsigned *r, size_t n, double *to, const double *from)
{
    for (size_t i = 0; i < n; i++) {
        size_t size;
        double *at = place(o, arrays, r[i], &size);
        if (r[i] == Y && to && o->mode > INITIALIZATION) {
            *to++ = o->x[0] * o->x[1] + 2 * o->w[1];
            continue;
        }
        if (!at || (from && r[i] == K && o->mode > INITIALIZATION)) return ERROR;
        if (from) memcpy(at, from, size * sizeof *at), from += size;
        else memcpy(to, at, size * sizeof *at), to += size;
    }
    return OK;
}

static int reset(void *c)
{
    Oscillator fresh = {START, {0, 0}, 1, {0, 0}, 0};
    *(Oscillator *)c = fresh;
    return OK;
}

static int go(void *c, int from, int to)
{
    Oscillator *o = c;
    if (o->mode != from) return ERROR;
    o->mode = to;
    return OK;
}

static int set_states(void *c, const double *x, size_t n)
{
    Oscillator *o = c;
    if (o->mode != CONTINUOUS || n != 2) return ERROR;
    memcpy(o->x, x, sizeof o->x);
    return OK;
}

static int rates(void *c, double *dx, size_t n)
{
    Oscillator *o = c;
    if (o->mode < EVENT || n != 2) return ERROR;
    dx[0] = o->x[1];
    dx[1] = o->k * (1 - o->x[0] * o->x[0]) * o->x[1] - o->x[0] + o->w[1] + o->begin;
    return OK;
}

static int begin(void *c, double time)
{
    ((Oscillator *)c)->begin = time;
    return OK;
}

/* A communication step by 400 steps of the Runge-Kutta method of order 4. */
static int advance(void *c, double from, double length)
{
    static const double at[4] = {0, 0.5, 0.5, 1}, weight[4] = {1, 2, 2, 1};
    Oscillator *o = c;
    if (o->mode != EVENT || from != o->begin) return ERROR;
    for (int n = 0; n < 400; n++) {
        double x[2] = {o->x[0], o->x[1]}, next[2] = {o->x[0], o->x[1]}, k[2] = {0, 0};
        for (int s = 0; s < 4; s++) {
            for (int i = 0; i < 2; i++) o->x[i] = x[i] + at[s] * length / 400 * k[i];
            rates(o, k, 2);
            for (int i = 0; i < 2; i++) next[i] += weight[s] * length / 2400 * k[i];
        }
        memcpy(o->x, next, sizeof next);
    }
    return OK;
}

static int directional(Oscillator *o, int arrays, const unsigned *to, size_t nt, const unsigned *from,
                       size_t nf, const double *seed, double *slope)
{
    double change[2] = {0, 0}, dk = 0, du = 0, all[2];
    for (size_t i = 0; i < nf; i++) {
        size_t size;
        double *at = place(o, arrays, from[i], &size);
        if (!at || (from[i] == K && o->mode != INITIALIZATION)) return ERROR;
        for (size_t j = 0; j < size; j++, at++, seed++) {
            if (at == &o->k) dk = *seed;
            else if (at == &o->w[1]) du = *seed;
            else if (at != &o->w[0]) change[at - o->x] = *seed;
        }
    }
    if (o->mode == START || o->mode == EVENT || o->x[0] > 9) return ERROR;
    double damping = 1 - o->x[0] * o->x[0];
    all[0] = change[1];
    all[1] = (-2 * o->k * o->x[0] * o->x[1] - 1) * change[0] + o->k * damping * change[1]
        + damping * o->x[1] * dk + du;
    if (arrays) return nt == 1 && to[0] == RATE ? (memcpy(slope, all, sizeof all), OK) : ERROR;
    for (size_t i = 0; i < nt; i++) {
        if (to[i] < RATE || to[i] > RATE + 1) return ERROR;
        slope[i] = all[to[i] - RATE];
    }
    return OK;
}

#define BOTH(V) \
    void fmi##V##FreeInstance(void *c) { free(c); } \
    int fmi##V##Reset(void *c) { return reset(c); } \
    int fmi##V##ExitInitializationMode(void *c) { return go(c, INITIALIZATION, EVENT); } \
    int fmi##V##EnterContinuousTimeMode(void *c) { return go(c, EVENT, CONTINUOUS); } \
    int fmi##V##SetContinuousStates(void *c, const double *x, size_t n) { return set_states(c, x, n); }

#if FMI_VERSION == 2
BOTH(2)
void *fmi2Instantiate(const char *n, int t, const char *g, const char *r, const void *f, int v, int l)
{
    (void)n, (void)t, (void)g, (void)r, (void)f, (void)v, (void)l;
    return instance();
}
int fmi2SetupExperiment(void *c, int d, double t, double s, int e, double stop)
{
    (void)d, (void)t, (void)e, (void)stop;
    return begin(c, s);
}
int fmi2DoStep(void *c, double from, double length, int n) { (void)n; return advance(c, from, length); }
int fmi2EnterInitializationMode(void *c) { return go(c, START, INITIALIZATION); }
int fmi2SetReal(void *c, const unsigned *r, size_t n, const double *v) { return copy(c, 0, r, n, NULL, v); }
int fmi2GetReal(void *c, const unsigned *r, size_t n, double *v) { return copy(c, 0, r, n, v, NULL); }
int fmi2GetDerivatives(void *c, double *dx, size_t n) { return rates(c, dx, n); }
int fmi2NewDiscreteStates(void *c, void *info) { memset(info, 0, 5 * sizeof(int)); return go(c, EVENT, EVENT); }
int fmi2GetDirectionalDerivative(void *c, const unsigned *to, size_t nt, const unsigned *from, size_t nf,
                                 const double *seed, double *slope)
{
    return directional(c, 0, to, nt, from, nf, seed, slope);
}
#else
BOTH(3)
void *fmi3InstantiateModelExchange(const char *n, const char *t, const char *r, bool v, bool l, void *e, void *log)
{
    (void)n, (void)t, (void)r, (void)v, (void)l, (void)e, (void)log;
    return instance();
}
void *fmi3InstantiateCoSimulation(const char *n, const char *t, const char *r, bool v, bool l, bool e,
                                  bool early, const uint32_t *vr, size_t count, void *env, void *log,
                                  void *update)
{
    (void)n, (void)t, (void)r, (void)v, (void)l, (void)e, (void)early, (void)vr, (void)count, (void)env;
    (void)log, (void)update;
    return instance();
}
int fmi3DoStep(void *c, double from, double length, bool n, bool *event, bool *end, bool *early, double *last)
{
    (void)n;
    *event = *end = *early = false;
    *last = from + length;
    return advance(c, from, length);
}
int fmi3EnterInitializationMode(void *c, bool d, double t, double s, bool e, double stop)
{
    (void)d, (void)t, (void)e, (void)stop;
    return begin(c, s) | go(c, START, INITIALIZATION);
}
int fmi3SetFloat64(void *c, const uint32_t *r, size_t n, const double *v, size_t m)
{
    (void)m;
    return copy(c, 1, r, n, NULL, v);
}
int fmi3GetFloat64(void *c, const uint32_t *r, size_t n, double *v, size_t m)
{
    (void)m;
    return copy(c, 1, r, n, v, NULL);
}
int fmi3GetContinuousStateDerivatives(void *c, double *dx, size_t n) { return rates(c, dx, n); }
int fmi3UpdateDiscreteStates(void *c, bool *a, bool *b, bool *d, bool *e, bool *f, double *next)
{
    *a = *b = *d = *e = *f = false;
    *next = 0;
    return go(c, EVENT, EVENT);
}
int fmi3GetDirectionalDerivative(void *c, const uint32_t *to, size_t nt, const uint32_t *from, size_t nf,
                                 const double *seed, size_t ns, double *slope, size_t n)
{
    return ns >= 2 && n == 2 ? directional(c, 1, to, nt, from, nf, seed, slope) : ERROR;
}
#endif
