/* One step of T of a model, with its Jacobian. The compiler is told NX states and NU inputs. */
#ifndef MODEL_H
#define MODEL_H

#define COLUMNS (NX + NU)
/* Columns by rows of a multiple of 4, so that the compiler takes whole vectors. */
#define PADDED ((COLUMNS + 3) / 4 * 4)

/* next[i] is state i after T, jacobian[i][j] its derivative by state j or input j - NX. */
void model_step(const double *x, const double *u, double *next, double jacobian[NX][PADDED]);

#endif
