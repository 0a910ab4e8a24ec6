@BANNER@
#ifndef PINC_RUNGE_KUTTA_H
#define PINC_RUNGE_KUTTA_H

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

/** The time derivative of the state x under the input u. */
void pinc_@RK@_derivative(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                         PINC_REAL dx[PINC_NX]);

/**
 * The state after T seconds from the state x under the constant input u.
 * The arrays must not overlap.
 */
void pinc_@RK@_step(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                   PINC_REAL next[PINC_NX]);

/**
 * The same with its Jacobians, row by row: a[i * PINC_NX + k] is the derivative of next[i] by
 * x[k], b[i * @WIDTH@ + k] that by u[k].
 */
void pinc_@RK@_linearize(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                        PINC_REAL next[PINC_NX], PINC_REAL a[PINC_NX * PINC_NX],
                        PINC_REAL b[PINC_NX * @WIDTH@]);

/** At most so many points are linearized at once. */
#define PINC_BATCH PINC_LANES

/** The same at so many points, one behind the other in each array. */
void pinc_@RK@_linearize_all(int points, const PINC_REAL *x, const PINC_REAL *u, PINC_REAL *next,
                            PINC_REAL *a, PINC_REAL *b);

#ifdef __cplusplus
}
#endif

#endif
