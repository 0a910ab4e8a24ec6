/* ---- A dense quadratic program: dual active-set method of Goldfarb and Idnani (1983) ------- */

/* How a dense program, or a part of the method, ended; early: when there was no step yet. */
typedef enum { PINC_QP_SOLVED, PINC_QP_CONTINUES, PINC_QP_INFEASIBLE, PINC_QP_FAILED,
               PINC_QP_EXPIRED, PINC_QP_EXPIRED_EARLY } pinc_qp_status;

/* H + proximal I = L L'; L below the diagonal column by column, mirrored above. Fails if that is not
   positive. */
static pinc_qp_status pinc_factor(pinc_mpc *m)
{
    pinc_dense *s = &m->dense;
    const int n = PINC_INPUTS;
    int c;
    int i;
    pinc_copy(s->factor, s->hessian, n * n);
    for (c = 0; c < n; c++) {
        s->factor[(c * n) + c] += s->proximal;
    }
    for (c = 0; c < n; c++) {
        PINC_REAL *column = s->factor + ((c * n) + c);
        const PINC_REAL pivot = column[0];
        PINC_REAL inverse;
        if (((c % PINC_UNASKED_COLUMNS) == (PINC_UNASKED_COLUMNS - 1)) && (pinc_expired(m) != 0)) {
            return PINC_QP_EXPIRED_EARLY;
        }
        if (!(pivot > PINC_SMALLEST_PIVOT * s->hessian[(c * n) + c])) {
            return PINC_QP_FAILED;
        }
        inverse = PINC_N(1) / PINC_MATH(sqrt)(pivot);
        s->inverse_diagonal[c] = inverse;
        for (i = 0; i < n - c; i++) {
            column[i] *= inverse;
        }
        for (i = 0; c + 1 + i < n; i++) {
            PINC_REAL *target = s->factor + ((c + 1 + i) * n);
            const PINC_REAL entry = column[1 + i];
            target[c] = entry;
            pinc_add_scaled(target + (c + 1 + i), -entry, column + (1 + i), n - (c + 1 + i));
        }
    }
    return PINC_QP_CONTINUES;
}

/* v <- L^-1 v */
static void pinc_forward(const pinc_dense *s, PINC_REAL *v)
{
    const int n = PINC_INPUTS;
    int c;
    for (c = 0; c < n; c++) {
        const PINC_REAL value = v[c] * s->inverse_diagonal[c];
        v[c] = value;
        pinc_add_scaled(v + (c + 1), -value, s->factor + ((c * n) + c + 1), n - (c + 1));
    }
}

/* v <- L'^-1 v */
static void pinc_backward(const pinc_dense *s, PINC_REAL *v)
{
    const int n = PINC_INPUTS;
    int r;
    for (r = n - 1; r >= 0; r--) {
        const PINC_REAL value = v[r] * s->inverse_diagonal[r];
        v[r] = value;
        pinc_add_scaled(v, -value, s->factor + (r * n), r);
    }
}

/* Moves what of z is in the range of Q to w; gives what |z|^2 is then. */
static PINC_REAL pinc_project_out(pinc_dense *s)
{
    const int n = PINC_INPUTS;
    int k;
    for (k = 0; k < s->members; k++) {
        const PINC_REAL *q = s->q + (k * n);
        const PINC_REAL part = pinc_dot(q, s->z, n);
        s->w[k] += part;
        pinc_add_scaled(s->z, -part, q, n);
    }
    return pinc_dot(s->z, s->z, n);
}

/* Appends the column Q w + z, where |z|^2 = squared, to Q R. */
static void pinc_qr_push(pinc_dense *s, PINC_REAL squared)
{
    const int n = PINC_INPUTS;
    const int at = s->members * n;
    const PINC_REAL norm = PINC_MATH(sqrt)(squared);
    const PINC_REAL inverse = PINC_N(1) / norm;
    int i;
    for (i = 0; i < n; i++) {
        s->q[at + i] = s->z[i] * inverse;
    }
    pinc_copy(s->r + at, s->w, s->members);
    s->r[at + s->members] = norm;
}

/* Removes a column of Q R, of which members are left then. */
static void pinc_qr_remove(pinc_dense *s, int gone, int members)
{
    const int n = PINC_INPUTS;
    int c;
    int k;
    int i;
    for (c = gone; c < members; c++) {
        pinc_copy(s->r + (c * n), s->r + ((c + 1) * n), c + 2);
    }
    for (c = gone; c < members; c++) {
        const PINC_REAL a = s->r[(c * n) + c];
        const PINC_REAL b = s->r[(c * n) + c + 1];
        const PINC_REAL length = PINC_MATH(hypot)(a, b);
        const PINC_REAL cosine = a / length;
        const PINC_REAL sine = b / length;
        PINC_REAL *first = s->q + (c * n);
        PINC_REAL *second = s->q + ((c + 1) * n);
        for (k = c; k < members; k++) {
            PINC_REAL *column = s->r + (k * n);
            const PINC_REAL upper = column[c];
            const PINC_REAL lower = column[c + 1];
            column[c] = (cosine * upper) + (sine * lower);
            column[c + 1] = (cosine * lower) - (sine * upper);
        }
        for (i = 0; i < n; i++) {
            const PINC_REAL one = first[i];
            const PINC_REAL two = second[i];
            first[i] = (cosine * one) + (sine * two);
            second[i] = (cosine * two) - (sine * one);
        }
    }
}

/* v <- R^-1 v */
static void pinc_qr_solve(const pinc_dense *s, PINC_REAL *v)
{
    const int n = PINC_INPUTS;
    int c;
    for (c = s->members - 1; c >= 0; c--) {
        const PINC_REAL *column = s->r + (c * n);
        v[c] /= column[c];
        pinc_add_scaled(v, -v[c], column, c);
    }
}

/* y += Q (v - Q'y), so that Q'y = v; v becomes what was missing. */
static void pinc_qr_meet(pinc_dense *s, PINC_REAL *v)
{
    const int n = PINC_INPUTS;
    int k;
    for (k = 0; k < s->members; k++) {
        v[k] -= pinc_dot(s->q + (k * n), s->y, n);
    }
    for (k = 0; k < s->members; k++) {
        pinc_add_scaled(s->y, v[k], s->q + (k * n), n);
    }
}

/* The normal of a row: a unit vector, or a row of C. */
static void pinc_normal(const pinc_dense *s, int row, PINC_REAL *normal)
{
    int i;
    for (i = 0; i < PINC_INPUTS; i++) {
        if (row < PINC_INPUTS) {
            normal[i] = (i == row) ? PINC_N(1) : PINC_N(0);
        } else {
            normal[i] = s->matrix[(i * PINC_ROWS) + (row - PINC_INPUTS)];
        }
    }
}

/* (x, C x) */
static void pinc_row_values(pinc_dense *s)
{
    int i;
    pinc_copy(s->values, s->x, PINC_INPUTS);
    pinc_fill(s->values + PINC_INPUTS, PINC_N(0), PINC_ROWS);
    for (i = 0; i < PINC_INPUTS; i++) {
        pinc_add_scaled(s->values + PINC_INPUTS, s->x[i], s->matrix + (i * PINC_ROWS), PINC_ROWS);
    }
}

/* A row held at a bound, with the limits of its multiplier. */
typedef struct {
    int row;
    PINC_REAL bound;
    PINC_REAL least;
    PINC_REAL most;
    /* Of a row that is off: on which side, and by how much. */
    PINC_REAL sign;
    PINC_REAL gap;
} pinc_row;

static pinc_row pinc_row_at(const pinc_dense *s, int row, int upper)
{
    const int equality = (s->low[row] >= s->high[row]) ? 1 : 0;
    pinc_row member;
    member.row = row;
    member.bound = (upper != 0) ? s->high[row] : s->low[row];
    member.least = ((upper != 0) && (equality == 0)) ? PINC_N(0) : -s->penalty[row];
    member.most = ((upper != 0) || (equality != 0)) ? s->penalty[row] : PINC_N(0);
    member.sign = PINC_N(1);
    member.gap = PINC_N(0);
    return member;
}

static void pinc_join(pinc_dense *s, const pinc_row *member, PINC_REAL squared)
{
    pinc_qr_push(s, squared);
    s->working[s->members] = member->row;
    s->bound[s->members] = member->bound;
    s->least[s->members] = member->least;
    s->most[s->members] = member->most;
    s->members++;
}

static void pinc_leave(pinc_dense *s, int gone)
{
    int k;
    s->members--;
    for (k = gone; k < s->members; k++) {
        s->working[k] = s->working[k + 1];
        s->bound[k] = s->bound[k + 1];
        s->least[k] = s->least[k + 1];
        s->most[k] = s->most[k + 1];
    }
    pinc_qr_remove(s, gone, s->members);
}

/* Splits the normal of a row into w and z; gives |z|^2 and whether that is nothing. */
static PINC_REAL pinc_split(pinc_dense *s, int row, int *dependent)
{
    PINC_REAL whole;
    PINC_REAL squared;
    pinc_normal(s, row, s->z);
    pinc_forward(s, s->z);
    whole = pinc_dot(s->z, s->z, PINC_INPUTS);
    pinc_fill(s->w, PINC_N(0), s->members);
    squared = pinc_project_out(s);
    if (squared < PINC_N(0.25) * whole) {
        squared = pinc_project_out(s);
    }
    *dependent = ((squared <= PINC_DEPENDENT * PINC_DEPENDENT * whole) ||
                  (s->members == PINC_INPUTS))
                     ? 1
                     : 0;
    return squared;
}

/* Computes y and the multipliers of the working set afresh. */
static void pinc_resolve(pinc_dense *s)
{
    const int n = PINC_INPUTS;
    int twice = (s->proximal > PINC_N(0)) ? 1 : 0;
    int k;
    int i;
    for (k = 0; k < s->members; k++) {
        s->mu[s->working[k]] = PINC_N(0);
    }
    for (i = 0; i < n; i++) {
        s->y[i] = -s->linear[i];
    }
    for (k = 0; k < PINC_LIMITS; k++) {
        if (pinc_abs(s->mu[k]) > PINC_N(0)) {
            pinc_normal(s, k, s->z);
            pinc_add_scaled(s->y, -s->mu[k], s->z, n);
            twice = 1;
        }
    }
    pinc_forward(s, s->y);
    for (k = 0; k < s->members; k++) {
        const PINC_REAL *column = s->r + (k * n);
        s->rates[k] = (s->bound[k] - pinc_dot(column, s->rates, k)) / column[k];
    }
    pinc_copy(s->z, s->rates, s->members);
    pinc_qr_meet(s, s->rates);
    if (twice != 0) {
        /* What no working row holds is as large in y as 1 / proximal, or as what violations cost: this takes
           off what rounding left. */
        pinc_qr_meet(s, s->z);
        pinc_add_scaled(s->rates, PINC_N(1), s->z, s->members);
    }
    pinc_qr_solve(s, s->rates);
    for (k = 0; k < s->members; k++) {
        s->mu[s->working[k]] = -s->rates[k];
    }
}

/* The member of the working set whose multiplier is furthest outside its limits, or -1. */
static int pinc_most_excessive(const pinc_dense *s)
{
    int worst = -1;
    PINC_REAL largest = PINC_N(0);
    int k;
    for (k = 0; k < s->members; k++) {
        const PINC_REAL mu = s->mu[s->working[k]];
        const PINC_REAL excess = pinc_max(s->least[k] - mu, mu - s->most[k]);
        if (excess > largest) {
            worst = k;
            largest = excess;
        }
    }
    return worst;
}

static PINC_REAL pinc_clamp(PINC_REAL v, PINC_REAL least, PINC_REAL most)
{
    return pinc_min(pinc_max(v, least), most);
}

/* Takes a row with the multiplier mu into the working set, if it can be. */
static void pinc_try_warm_row(pinc_dense *s, int row, PINC_REAL mu)
{
    const pinc_row member = pinc_row_at(s, row, (mu > PINC_N(0)) ? 1 : 0);
    s->mu[row] = PINC_N(0);
    if (pinc_finite(member.bound) == 0) {
        return;
    }
    if (pinc_abs(mu) >= s->penalty[row]) {
        s->mu[row] = pinc_clamp(mu, member.least, member.most);
    } else {
        int dependent = 0;
        const PINC_REAL squared = pinc_split(s, row, &dependent);
        if (dependent == 0) {
            pinc_join(s, &member, squared);
        }
    }
}

/* Computes y and the multipliers afresh, and takes the rows out of the working set whose multipliers
   are outside their limits. */
static void pinc_drop_excessive(pinc_dense *s)
{
    int gone;
    pinc_resolve(s);
    gone = pinc_most_excessive(s);
    while (gone >= 0) {
        const int row = s->working[gone];
        s->mu[row] = pinc_clamp(s->mu[row], s->least[gone], s->most[gone]);
        pinc_leave(s, gone);
        pinc_resolve(s);
        gone = pinc_most_excessive(s);
    }
}

/* Makes the working set of the multipliers given, less the rows whose multipliers it gets wrong. */
static pinc_qp_status pinc_start(pinc_mpc *m)
{
    pinc_dense *s = &m->dense;
    int row;
    s->members = 0;
    for (row = 0; row < PINC_LIMITS; row++) {
        if (pinc_abs(s->mu[row]) > PINC_N(0)) {
            if (((s->members % PINC_UNASKED_ROWS) == (PINC_UNASKED_ROWS - 1)) &&
                (pinc_expired(m) != 0)) {
                return PINC_QP_EXPIRED_EARLY;
            }
            pinc_try_warm_row(s, row, s->mu[row]);
        }
    }
    pinc_drop_excessive(s);
    return PINC_QP_CONTINUES;
}

/* Whether a row is off and its multiplier can be moved; writes how. */
static int pinc_candidate(const pinc_dense *s, int row, pinc_row *member)
{
    const PINC_REAL mu = s->mu[row];
    const PINC_REAL value = s->values[row];
    const int upper =
        ((mu > PINC_N(0)) || ((mu >= PINC_N(0)) && (value > s->high[row]))) ? 1 : 0;
    PINC_REAL off;
    PINC_REAL limit;
    int k;
    *member = pinc_row_at(s, row, upper);
    off = value - member->bound;
    member->sign = (off < PINC_N(0)) ? PINC_N(-1) : PINC_N(1);
    member->gap = pinc_abs(off);
    limit = (member->sign > PINC_N(0)) ? member->most : member->least;
    if (!(member->gap > s->tolerance * (PINC_N(1) + pinc_abs(member->bound))) ||
        !(member->sign * (limit - mu) > PINC_N(0))) {
        return 0;
    }
    for (k = 0; k < s->members; k++) {
        if (s->working[k] == row) {
            return 0;
        }
    }
    return 1;
}

/* The row that is most off, if there is one. */
static int pinc_worst(const pinc_dense *s, pinc_row *worst)
{
    PINC_REAL largest = PINC_N(0);
    int any = 0;
    int row;
    for (row = 0; row < PINC_LIMITS; row++) {
        const PINC_REAL mu = s->mu[row];
        const PINC_REAL above = s->values[row] - s->high[row];
        const PINC_REAL below = s->low[row] - s->values[row];
        PINC_REAL off = pinc_max(above, below);
        if (mu > PINC_N(0)) {
            off = pinc_abs(above);
        } else if (mu < PINC_N(0)) {
            off = pinc_abs(below);
        }
        if (off > largest) {
            pinc_row found;
            if (pinc_candidate(s, row, &found) != 0) {
                *worst = found;
                largest = off;
                any = 1;
            }
        }
    }
    return any;
}

/* A working row's rate times the length of its normal: a number in the units of the row whose
   multiplier changes, whatever the units of the working row. */
static PINC_REAL pinc_rate_length(const pinc_dense *s, int k)
{
    const PINC_REAL *column = s->r + (k * PINC_INPUTS);
    return PINC_MATH(sqrt)(pinc_dot(column, column, k + 1)) * pinc_abs(s->rates[k]);
}

/* Where a rate's length is below this it is mere rounding. */
static PINC_REAL pinc_rounding(const pinc_dense *s)
{
    PINC_REAL largest = PINC_N(0);
    int k;
    for (k = 0; k < s->members; k++) {
        largest = pinc_max(largest, pinc_rate_length(s, k));
    }
    return PINC_DEPENDENT * largest;
}

/* The working row whose multiplier comes to a limit first, or -1; writes when. */
static int pinc_first_at_limit(const pinc_dense *s, PINC_REAL sign, int dependent, PINC_REAL *when)
{
    const PINC_REAL rounding = (dependent != 0) ? pinc_rounding(s) : PINC_N(0);
    int first = -1;
    int k;
    *when = PINC_INFINITY;
    for (k = 0; k < s->members; k++) {
        const PINC_REAL rate = -sign * s->rates[k];
        if ((pinc_abs(rate) > PINC_N(0)) &&
            ((dependent == 0) || (pinc_rate_length(s, k) > rounding))) {
            const PINC_REAL limit = (rate > PINC_N(0)) ? s->most[k] : s->least[k];
            const PINC_REAL t = pinc_max((limit - s->mu[s->working[k]]) / rate, PINC_N(0));
            if (t < *when) {
                *when = t;
                first = k;
            }
        }
    }
    return first;
}

/* Splits the normal of a row, and computes the rates of the working rows' multipliers; gives |z|^2
   and whether that is nothing. */
static PINC_REAL pinc_find_rates(pinc_dense *s, int row, int *dependent)
{
    const PINC_REAL squared = pinc_split(s, row, dependent);
    pinc_copy(s->rates, s->w, s->members);
    pinc_qr_solve(s, s->rates);
    return squared;
}

/* x and (x, C x) of y. */
static void pinc_find_x(pinc_dense *s)
{
    pinc_copy(s->x, s->y, PINC_INPUTS);
    pinc_backward(s, s->x);
    pinc_row_values(s);
}

/* The sum of the absolute values of what the row's value is the sum of. */
static PINC_REAL pinc_terms(pinc_dense *s, int row)
{
    PINC_REAL terms = PINC_N(0);
    int k;
    pinc_normal(s, row, s->z);
    for (k = 0; k < PINC_INPUTS; k++) {
        terms += pinc_abs(s->z[k] * s->x[k]);
    }
    return terms;
}

/* Whether no x up to PINC_FARTHEST meets all rows: their combination by mu is y'x, and would have to
   be below the height. */
static int pinc_is_proof(pinc_dense *s)
{
    PINC_REAL height = PINC_N(0);
    PINC_REAL remainder = PINC_N(0);
    int k;
    pinc_fill(s->y, PINC_N(0), PINC_INPUTS);
    for (k = 0; k < PINC_LIMITS; k++) {
        const PINC_REAL mu = s->mu[k];
        if (pinc_abs(mu) > PINC_N(0)) {
            pinc_normal(s, k, s->z);
            pinc_add_scaled(s->y, mu, s->z, PINC_INPUTS);
            height += mu * ((mu > PINC_N(0)) ? s->high[k] : s->low[k]);
        }
    }
    for (k = 0; k < PINC_INPUTS; k++) {
        remainder += pinc_abs(s->y[k]);
    }
    return ((height + (PINC_FARTHEST * remainder)) < PINC_N(0)) ? 1 : 0;
}

/* A row that is off and depends on rows that cannot yield. */
static pinc_qp_status pinc_certify(pinc_dense *s, const pinc_row *member)
{
    const PINC_REAL size = PINC_N(1) + pinc_abs(member->bound);
    PINC_REAL terms;
    PINC_REAL gap;
    PINC_REAL rounding;
    int dependent = 0;
    int k;
    /* Without the rounding of the steps so far. */
    pinc_resolve(s);
    pinc_find_x(s);
    (void)pinc_find_rates(s, member->row, &dependent);
    gap = pinc_abs(s->values[member->row] - member->bound);
    terms = pinc_terms(s, member->row);
    if (pinc_finite(gap / (size + terms)) == 0) {
        return PINC_QP_FAILED;
    }
    if (gap <= PINC_CONFLICT * (size + terms)) {
        s->tolerance = pinc_max(s->tolerance, PINC_N(2) * gap / size);
        return PINC_QP_CONTINUES;
    }
    pinc_fill(s->mu, PINC_N(0), PINC_LIMITS);
    s->mu[member->row] = member->sign;
    rounding = pinc_rounding(s);
    for (k = 0; k < s->members; k++) {
        if (pinc_rate_length(s, k) > rounding) {
            s->mu[s->working[k]] = -member->sign * s->rates[k];
        }
    }
    return (pinc_is_proof(s) != 0) ? PINC_QP_INFEASIBLE : PINC_QP_FAILED;
}

/* Moves the multiplier of a row until the row is met, or the multiplier is at its limit. */
static pinc_qp_status pinc_add_row(pinc_dense *s, const pinc_row *member)
{
    const int row = member->row;
    const PINC_REAL sign = member->sign;
    const PINC_REAL limit = (sign > PINC_N(0)) ? member->most : member->least;
    PINC_REAL gap = member->gap;
    int pass;
    /* Each pass but the last makes the working set smaller. */
    for (pass = 0; pass <= PINC_INPUTS; pass++) {
        int dependent = 0;
        int leaving;
        int own_limit = 0;
        int leaves = 0;
        int k;
        PINC_REAL when;
        PINC_REAL step;
        PINC_REAL own;
        const PINC_REAL squared = pinc_find_rates(s, row, &dependent);
        s->changes++;
        step = (dependent != 0) ? PINC_INFINITY : (gap / squared);
        own = sign * (limit - s->mu[row]);
        if (own < step) {
            step = own;
            own_limit = 1;
        }
        leaving = pinc_first_at_limit(s, sign, dependent, &when);
        if ((leaving >= 0) && (when < step)) {
            step = when;
            own_limit = 0;
            leaves = 1;
        }
        if (step >= PINC_INFINITY) {
            return pinc_certify(s, member);
        }
        s->mu[row] += sign * step;
        for (k = 0; k < s->members; k++) {
            s->mu[s->working[k]] -= sign * step * s->rates[k];
        }
        if (dependent == 0) {
            pinc_add_scaled(s->y, -sign * step, s->z, PINC_INPUTS);
            gap -= step * squared;
        }
        if (leaves != 0) {
            const int falling = (-sign * s->rates[leaving] < PINC_N(0)) ? 1 : 0;
            s->mu[s->working[leaving]] = (falling != 0) ? s->least[leaving] : s->most[leaving];
            pinc_leave(s, leaving);
        } else if (own_limit != 0) {
            s->mu[row] = limit;
            return PINC_QP_CONTINUES;
        } else {
            pinc_join(s, member, squared);
            return PINC_QP_CONTINUES;
        }
    }
    return PINC_QP_FAILED;
}

/* Whether the solution is made of numbers, and the working rows are where they are held, which
   rounding prevents where H is near singular. */
static int pinc_is_met(pinc_dense *s)
{
    int k;
    for (k = 0; k < s->members; k++) {
        const PINC_REAL off = pinc_abs(s->values[s->working[k]] - s->bound[k]);
        const PINC_REAL size = PINC_N(1) + pinc_abs(s->bound[k]);
        if (!(off <= (PINC_NEAR * size)) &&
            !(off <= (PINC_NEAR * (size + pinc_terms(s, s->working[k]))))) {
            return 0;
        }
    }
    return pinc_all_finite(s->values, PINC_LIMITS) & pinc_all_finite(s->mu, PINC_LIMITS);
}

/* Brings multipliers that rounding has left outside into their limits: on the other side of a row there
   may be none that is finite. */
static void pinc_clear_rounding(pinc_dense *s)
{
    int k;
    for (k = 0; k < s->members; k++) {
        const int row = s->working[k];
        s->mu[row] = pinc_clamp(s->mu[row], s->least[k], s->most[k]);
    }
}

/* Finds x for the working set and changes this until all rows are met. */
static pinc_qp_status pinc_meet_rows(pinc_mpc *m)
{
    pinc_dense *s = &m->dense;
    int fresh = 1;
    while (s->changes <= 10 * (PINC_LIMITS + 10)) {
        pinc_row worst = pinc_row_at(s, 0, 0);
        pinc_find_x(s);
        if (pinc_worst(s, &worst) != 0) {
            pinc_qp_status status;
            if ((s->changes > 0) && (pinc_expired(m) != 0)) {
                return PINC_QP_EXPIRED;
            }
            fresh = 0;
            status = pinc_add_row(s, &worst);
            if (status != PINC_QP_CONTINUES) {
                return status;
            }
        } else if (fresh != 0) {
            if (pinc_is_met(s) == 0) {
                return PINC_QP_FAILED;
            }
            pinc_clear_rounding(s);
            return PINC_QP_SOLVED;
        } else {
            pinc_resolve(s);
            fresh = 1;
        }
    }
    return PINC_QP_FAILED;
}

/* Takes x for the next proximal point; 1 if it is another than before. */
static int pinc_move_center(pinc_dense *s)
{
    PINC_REAL slope = PINC_N(0);
    PINC_REAL largest = PINC_N(0);
    int i;
    for (i = 0; i < PINC_INPUTS; i++) {
        const PINC_REAL next = s->gradient[i] - (s->proximal * s->x[i]);
        slope = pinc_max(slope, pinc_abs(next - s->linear[i]));
        largest = pinc_max(largest, pinc_abs(s->gradient[i]));
        s->linear[i] = next;
    }
    if (slope <= (PINC_SLOPE * (PINC_N(1) + largest))) {
        return 0;
    }
    pinc_drop_excessive(s);
    return 1;
}

/* Solves from the multipliers in mu, if the factorization before left something to do. */
static pinc_qp_status pinc_dense_pass(pinc_mpc *m, pinc_qp_status factored)
{
    pinc_qp_status status = factored;
    m->dense.changes = 0;
    if (status == PINC_QP_CONTINUES) {
        status = pinc_start(m);
    }
    return (status == PINC_QP_CONTINUES) ? pinc_meet_rows(m) : status;
}

/* Solves the dense program, starting from the multipliers in mu. With a singular H by the proximal
   point method (Rockafellar 1976): H + proximal I instead, about the last x until that stays. */
static pinc_qp_status pinc_dense_solve(pinc_mpc *m)
{
    pinc_dense *s = &m->dense;
    PINC_REAL largest = PINC_N(0);
    pinc_qp_status status;
    int center;
    int more;
    int i;
    s->tolerance = PINC_MET;
    s->proximal = PINC_N(0);
    pinc_copy(s->linear, s->gradient, PINC_INPUTS);
    status = pinc_dense_pass(m, pinc_factor(m));
    if (status != PINC_QP_FAILED) {
        return status;
    }
    for (i = 0; i < PINC_INPUTS; i++) {
        largest = pinc_max(largest, s->hessian[i * (PINC_INPUTS + 1)]);
    }
    s->proximal = PINC_PROXIMAL * ((largest > PINC_N(0)) ? largest : PINC_N(1));
    status = pinc_factor(m);
    for (more = 0; (more < 2) && (status == PINC_QP_FAILED); more++) {
        s->proximal *= PINC_N(100);
        status = pinc_factor(m);
    }
    status = pinc_dense_pass(m, status);
    for (center = 0; center < PINC_CENTERS; center++) {
        if ((status != PINC_QP_SOLVED) || (pinc_move_center(s) == 0)) {
            return status;
        }
        status = pinc_meet_rows(m);
    }
    return PINC_QP_FAILED;
}
