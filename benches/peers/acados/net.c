/* A net of DEPTH hidden layers of WIDTH neurons, with the Jacobian by reverse mode: fewer rows than
   a forward mode has columns. net_weights.h is written by compare.py, with T and the normalizers
   folded into the first and the last layer, and WIDTH padded with zeros to whole blocks. */
#include <math.h>
#include <string.h>

#include "model.h"
#include "net_weights.h"

enum { BLOCK = 8 };

void model_step(const double *x, const double *u, double *next, double jacobian[NX][PADDED]) {
    double a[DEPTH][WIDTH], z[WIDTH], g[NX][WIDTH], back[NX][WIDTH];
    memcpy(z, bias_in, sizeof z);
    for (int k = 0; k < COLUMNS; k++) {
        const double input = k < NX ? x[k] : u[k - NX];
        for (int i = 0; i < WIDTH; i++) z[i] += weight_in[k][i] * input;
    }
    for (int layer = 0; layer < DEPTH; layer++) {
        for (int i = 0; i < WIDTH; i++) a[layer][i] = tanh(z[i]);
        if (layer + 1 == DEPTH) break;
        memcpy(z, bias[layer], sizeof z);
        for (int k = 0; k < WIDTH; k++) {
            for (int i = 0; i < WIDTH; i++) z[i] += weight_transposed[layer][k][i] * a[layer][k];
        }
    }
    for (int r = 0; r < NX; r++) {
        double sum = bias_out[r] + (HARD ? x[r] : 0.0);
        for (int i = 0; i < WIDTH; i++) sum += weight_out[r][i] * a[DEPTH - 1][i];
        next[r] = sum;
        memcpy(g[r], weight_out[r], sizeof g[r]);
    }
    for (int layer = DEPTH - 1; layer >= 0; layer--) {
        for (int r = 0; r < NX; r++) {
            for (int i = 0; i < WIDTH; i++) g[r][i] *= 1 - a[layer][i] * a[layer][i];
        }
        if (layer == 0) break;
        /* A block of columns of all rows at a time, whose sums stay in registers. */
        for (int k = 0; k < WIDTH; k += BLOCK) {
            double sum[NX][BLOCK] = {{0}};
            for (int i = 0; i < WIDTH; i++) {
                for (int r = 0; r < NX; r++) {
                    for (int l = 0; l < BLOCK; l++) {
                        sum[r][l] += g[r][i] * weight[layer - 1][i][k + l];
                    }
                }
            }
            for (int r = 0; r < NX; r++) memcpy(back[r] + k, sum[r], sizeof sum[r]);
        }
        memcpy(g, back, sizeof back);
    }
    for (int r = 0; r < NX; r++) {
        for (int j = 0; j < COLUMNS; j++) {
            double sum = HARD && r == j ? 1.0 : 0.0;
            for (int i = 0; i < WIDTH; i++) sum += g[r][i] * weight_in[j][i];
            jacobian[r][j] = sum;
        }
    }
}
