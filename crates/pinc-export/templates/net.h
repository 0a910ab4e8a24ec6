@BANNER@
#ifndef PINC_NET_H
#define PINC_NET_H

#ifdef __cplusplus
extern "C" {
#endif

@REAL@
/** Number of states. */
#define PINC_NX @NX@
/** Number of inputs. */
#define PINC_NU @NU@
@PARAMETERS@/** Length T of a step, in s. */
#define PINC_SAMPLE_TIME_S @T@

/**
 * The state after T seconds from the state x under the constant input u.
 * The arrays must not overlap.
 */
void pinc_net_step(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                   PINC_REAL next[PINC_NX]);

/**
 * The same with its Jacobians, row by row: a[i * PINC_NX + k] is the derivative of next[i] by
 * x[k], b[i * @WIDTH@ + k] that by u[k].
 */
void pinc_net_linearize(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                        PINC_REAL next[PINC_NX], PINC_REAL a[PINC_NX * PINC_NX],
                        PINC_REAL b[PINC_NX * @WIDTH@]);

/** At most so many points are linearized at once. */
#define PINC_BATCH ((PINC_LANES > 1) ? 4 : 1)

/** The same at so many points, one behind the other in each array. */
void pinc_net_linearize_all(int points, const PINC_REAL *x, const PINC_REAL *u, PINC_REAL *next,
                            PINC_REAL *a, PINC_REAL *b);
@AT@
#ifdef __cplusplus
}
#endif

#endif
