    /* The controller before and after the step at hand, and whether that is computed. */
    @CONTROLLER@ before;
    @CONTROLLER@ after;
    int computed;
    /* Steps that the controller has taken, from the start time on. */
    double start;
    double steps;
