    /* How large each state has been. */
    double largest[PINC_NX];
