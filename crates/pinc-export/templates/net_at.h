
/** The state after t seconds, 0 <= t <= T, from the state x under the constant input u. */
void pinc_net_at(PINC_REAL t, const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                 PINC_REAL next[PINC_NX]);
