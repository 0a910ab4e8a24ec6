        pinc_net_at(PINC_N(0.5 * PINC_SAMPLE_TIME_S), x, u, next);
        worst = pinc_larger(worst, pinc_difference(next, pinc_half[c], 1, NULL));
