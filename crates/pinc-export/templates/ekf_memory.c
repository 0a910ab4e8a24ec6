    PINC_REAL before[PINC_NZ * PINC_NZ];
    PINC_REAL work[PINC_NZ * PINC_NZ];
    PINC_REAL augmented[PINC_NZ * PINC_NZ];
    PINC_REAL a[PINC_NX * PINC_NX];
    PINC_REAL b[PINC_NX * PINC_NU];
    PINC_REAL next[PINC_NZ];
    PINC_REAL product[PINC_NZ];
    PINC_REAL gain[PINC_NZ];
    PINC_REAL change[PINC_NZ];
