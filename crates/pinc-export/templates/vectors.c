/* ---- Vectors and small matrices ------------------------------------------------------------ */

/* Whether a number is finite: the difference of infinities is NaN. */
static int pinc_finite(PINC_REAL v)
{
    const PINC_REAL zero = v - v;
    return (zero <= PINC_N(0)) ? 1 : 0;
}

static int pinc_all_finite(const PINC_REAL *v, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        if (pinc_finite(v[i]) == 0) {
            return 0;
        }
    }
    return 1;
}

static void pinc_fill(PINC_REAL *v, PINC_REAL value, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        v[i] = value;
    }
}

static void pinc_copy(PINC_REAL *to, const PINC_REAL *from, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        to[i] = from[i];
    }
}

/* sum += factor vector */
static void pinc_add_scaled(PINC_REAL *sum, PINC_REAL factor, const PINC_REAL *v, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        sum[i] += factor * v[i];
    }
}

/* a'b, in two sums side by side. */
static PINC_REAL pinc_dot(const PINC_REAL *a, const PINC_REAL *b, int count)
{
    PINC_REAL even = PINC_N(0);
    PINC_REAL odd = PINC_N(0);
    const PINC_REAL last = ((count % 2) == 1) ? (a[count - 1] * b[count - 1]) : PINC_N(0);
    int i;
    for (i = 0; i + 1 < count; i += 2) {
        even += a[i] * b[i];
        odd += a[i + 1] * b[i + 1];
    }
    return even + odd + last;
}

