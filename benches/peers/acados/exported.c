/* The net as `pinc export --to c --name net` writes it, for comparison with net.c. */
#include "model.h"
#include "net_net.c"

void model_step(const double *x, const double *u, double *next, double jacobian[NX][PADDED]) {
    double a[NX * NX], b[NX * NU];
    net_net_linearize(x, u, next, a, b);
    for (int i = 0; i < NX; i++) {
        for (int j = 0; j < NX; j++) jacobian[i][j] = a[i * NX + j];
        for (int j = 0; j < NU; j++) jacobian[i][NX + j] = b[i * NU + j];
    }
}
