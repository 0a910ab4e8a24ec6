
/** The same, with its derivative by t. */
void pinc_net_path(PINC_REAL t, const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                   PINC_REAL next[PINC_NX], PINC_REAL rate[PINC_NX]);
