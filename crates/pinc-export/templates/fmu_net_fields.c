    /* The chain of steps: where the marks are counted from, marks since then, and the state and
       the input at the last of them. */
    double origin;
    double marks;
    PINC_REAL state[PINC_NX];
    PINC_REAL input[PINC_NU];
