
/* The states after a step, from a group on. */
static void pinc_advance(pinc_vector z[PINC_GROUPS][PINC_ROW], int first)
{
    PINC_REAL x[PINC_NX];
    PINC_REAL u[PINC_NU];
    PINC_REAL next[PINC_NX];
    int point;
    int i;
    for (point = first * PINC_LANES; point < PINC_POINTS; point++) {
        pinc_vector *row = z[point / PINC_LANES];
        for (i = 0; i < PINC_NX; i++) {
            x[i] = PINC_LANE(row[i], point % PINC_LANES);
        }
        for (i = 0; i < PINC_NU; i++) {
            u[i] = PINC_LANE(row[PINC_NX + i], point % PINC_LANES);
        }
        pinc_net_step(x, u, next);
        for (i = 0; i < PINC_NX; i++) {
            PINC_LANE(row[i], point % PINC_LANES) = next[i];
        }
    }
}
