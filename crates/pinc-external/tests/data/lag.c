/* A lag x' = u - x as an FMU for co-simulation, of FMI 2.0. A step from x > 5 does not end. */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <unistd.h>

typedef struct {
    double x, u;
} Lag;

static Lag *lag(void *c) { return c; }

void *fmi2Instantiate(const char *n, int t, const char *g, const char *r, const void *f, int v, int l)
{
    (void)n, (void)t, (void)g, (void)r, (void)f, (void)v, (void)l;
    return calloc(1, sizeof(Lag));
}
void fmi2FreeInstance(void *c) { free(c); }
int fmi2Reset(void *c) { lag(c)->x = lag(c)->u = 0; return 0; }
int fmi2SetupExperiment(void *c, int d, double t, double s, int e, double stop)
{
    (void)c, (void)d, (void)t, (void)s, (void)e, (void)stop;
    return 0;
}
int fmi2EnterInitializationMode(void *c) { (void)c; return 0; }
int fmi2ExitInitializationMode(void *c) { (void)c; return 0; }
int fmi2SetReal(void *c, const unsigned *r, size_t n, const double *v)
{
    for (size_t i = 0; i < n; i++) *(r[i] == 1 ? &lag(c)->x : &lag(c)->u) = v[i];
    return 0;
}
int fmi2GetReal(void *c, const unsigned *r, size_t n, double *v)
{
    for (size_t i = 0; i < n; i++) v[i] = r[i] == 1 ? lag(c)->x : lag(c)->u;
    return 0;
}
int fmi2DoStep(void *c, double t, double h, int p)
{
    (void)t, (void)p;
    while (lag(c)->x > 5) pause();
    lag(c)->x = lag(c)->u + (lag(c)->x - lag(c)->u) * exp(-h);
    return 0;
}
