    /* The window: how many steps are in it, whether it has lost its first state, its states, what
       was applied and measured, and what was expected of each state, with covariances. */
    int steps;
    int moved_on;
    pinc_horizon now;
    PINC_REAL applied[PINC_STAGES * PINC_NU];
    /* The input that led to its first state, once there is a step. */
    PINC_REAL u_before[PINC_NU];
    PINC_REAL measured[PINC_STAGES * PINC_NM];
    PINC_REAL prior[PINC_STAGED];
    PINC_REAL prior_p[PINC_STAGED * PINC_NZ];
    /* Of the iteration: the step, where it begins, the last one, and the best solution. */
    pinc_horizon step;
    pinc_horizon base;
    pinc_horizon best;
    PINC_REAL last_x[PINC_STAGED];
    PINC_REAL last_v[PINC_STAGED];
    PINC_REAL last_length;
    int taken;
    /* The problem linearized: x_0 = prior + B v_0, the Jacobians of the other stages, defects
       without and with v, what is measured, the slope of the cost, and bounds on the step. */
    PINC_REAL root[PINC_NZ * PINC_NZ];
    PINC_REAL stage_a[PINC_STAGED * PINC_NZ];
    PINC_REAL defects[PINC_STAGED];
    PINC_REAL c[PINC_STAGED];
    PINC_REAL stage_h[PINC_STAGES * PINC_NM * PINC_NZ];
    PINC_REAL errors[PINC_STAGES * PINC_NM];
    PINC_REAL slope[PINC_STAGED];
    PINC_REAL below[PINC_STAGED];
    PINC_REAL above[PINC_STAGED];
    PINC_REAL cost;
    PINC_REAL kkt;
    PINC_REAL violation;
    /* Of its solution: what is expected of each stage, the gains, what is expected at the stage in
       hand, the rows that are held at a bound, and their multipliers before. */
    PINC_REAL mean[PINC_STAGED];
    PINC_REAL covariance[PINC_STAGED * PINC_NZ];
    PINC_REAL gains[PINC_STAGES * PINC_STAGE_ROWS * PINC_NZ];
    PINC_REAL weighted[PINC_STAGES * PINC_STAGE_ROWS];
    PINC_REAL m[PINC_NZ];
    PINC_REAL m_p[PINC_NZ * PINC_NZ];
    PINC_REAL row[PINC_NZ];
    int held[PINC_STAGED];
    PINC_REAL mu[PINC_STAGED];
