@BANNER@
#include "pinc_error.h"

/* Of pinc_exact.h, whose sizes of batches are other ones than those of pinc_net.h. */
#ifdef __cplusplus
extern "C"
#endif
void pinc_exact_step(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                     PINC_REAL next[PINC_NX]);

/* The distance from an integrator that stands for the exact solution. */
void pinc_error(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@], PINC_REAL error[PINC_NX])
{
    PINC_REAL exact[PINC_NX];
    int i;
    pinc_net_step(x, u, error);
    pinc_exact_step(x, u, exact);
    for (i = 0; i < PINC_NX; i++) {
        error[i] -= exact[i];
    }
}
