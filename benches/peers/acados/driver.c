/* The closed loop of a problem file, step by step, by acados' SQP. compare.py writes the file.

   driver PROBLEM QP COND_N MODE QP_TOLERANCE WARM FIRST SHIFT REPETITIONS

   QP           daqp, hpipm-full or hpipm-partial
   COND_N       stages that partial condensing leaves; 0 for the others
   MODE         HPIPM's: SPEED, BALANCE
   QP_TOLERANCE of each QP
   WARM         qp_warm_start
   FIRST        warm start of a step's first QP: 0 no, 1 from the QP before, 2 from the plan
   SHIFT        whether the plan is shifted by a stage before it is the first guess

   The state is the plant's and the input applied last, as increments are weighted. Prints a line
   per step: repetition, step, us, status, SQP iterations, largest KKT residual, inputs. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "acados/utils/external_function_generic.h"
#include "acados/utils/timing.h"
#include "acados_c/ocp_nlp_interface.h"
#include "blasfeo_d_aux.h"
#include "model.h"

enum { NZ = NX + NU, NEVER = -2 };

static double now_us(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e6 * now.tv_sec + 1e-3 * now.tv_nsec;
}

/* acados reads the clock all the time, for a tenth of a short step. The linker takes these. */
void acados_tic(acados_timer *timer) { (void)timer; }
double acados_toc(acados_timer *timer) { return (void)timer, 0.0; }

/* ------------------------------------------------------------------- the model, for acados */

static void evaluate(void **in, double *next, double jacobian[NX][PADDED], double *u) {
    const struct blasfeo_dvec_args *x_in = in[0], *u_in = in[1];
    memcpy(u, u_in->x->pa + u_in->xi, NU * sizeof *u);
    model_step(x_in->x->pa + x_in->xi, u, next, jacobian);
}

static void write_next(void *out, const double *next, const double *u) {
    const struct blasfeo_dvec_args *to = out;
    memcpy(to->x->pa + to->xi, next, NX * sizeof *next);
    memcpy(to->x->pa + to->xi + NX, u, NU * sizeof *u);
}

static void step(void *self, ext_fun_arg_t *type_in, void **in, ext_fun_arg_t *type_out,
                 void **out) {
    double next[NX], jacobian[NX][PADDED], u[NU];
    (void)self, (void)type_in, (void)type_out;
    evaluate(in, next, jacobian, u);
    write_next(out[0], next, u);
}

/* acados takes the Jacobian transposed: a row per input, state and last input. */
static void step_jacobian(void *self, ext_fun_arg_t *type_in, void **in, ext_fun_arg_t *type_out,
                          void **out) {
    double next[NX], jacobian[NX][PADDED], u[NU];
    (void)self, (void)type_in, (void)type_out;
    evaluate(in, next, jacobian, u);
    write_next(out[0], next, u);
    const struct blasfeo_dmat_args *to = out[1];
    struct blasfeo_dmat *a = to->A;
    const int row = to->ai, column = to->aj;
    for (int i = 0; i < NX; i++) {
        for (int j = 0; j < NU; j++) {
            BLASFEO_DMATEL(a, row + j, column + i) = jacobian[i][NX + j];
            BLASFEO_DMATEL(a, row + NU + NX + j, column + i) = 0.0;
        }
        for (int j = 0; j < NX; j++) {
            BLASFEO_DMATEL(a, row + NU + j, column + i) = jacobian[i][j];
        }
    }
    for (int i = 0; i < NU; i++) {
        for (int j = 0; j < NU + NZ; j++) {
            BLASFEO_DMATEL(a, row + j, column + NX + i) = i == j;
        }
    }
}

static size_t no_workspace(void *self) { return (void)self, 0; }
static void ignore_workspace(void *self, void *work) { (void)self, (void)work; }
static external_function_generic fun = {step, no_workspace, ignore_workspace};
static external_function_generic fun_jac = {step_jacobian, no_workspace, ignore_workspace};

/* ---------------------------------------------------------------------- the problem's file */

typedef struct {
    int n2, controlled, steps;
    int index[NX];
    double q[NX], r[NU], x_low[NX], x_high[NX], u_low[NU], u_high[NU];
    double *x, *before, *reference; /* by steps: state, input applied last, reference ahead */
} problem;

static double number(FILE *file) {
    double value;
    if (fscanf(file, "%lf", &value) != 1) {
        fprintf(stderr, "the problem's file is too short\n");
        exit(1);
    }
    return value;
}

static void numbers(FILE *file, double *to, int count) {
    for (int i = 0; i < count; i++) to[i] = number(file);
}

static problem read_problem(const char *path) {
    problem p;
    FILE *file = fopen(path, "r");
    if (!file) {
        perror(path);
        exit(1);
    }
    p.n2 = number(file), p.controlled = number(file), p.steps = number(file);
    for (int i = 0; i < p.controlled; i++) p.index[i] = number(file);
    numbers(file, p.q, p.controlled), numbers(file, p.r, NU);
    numbers(file, p.x_low, NX), numbers(file, p.x_high, NX);
    numbers(file, p.u_low, NU), numbers(file, p.u_high, NU);
    p.x = malloc(p.steps * NX * sizeof(double));
    p.before = malloc(p.steps * NU * sizeof(double));
    p.reference = malloc(p.steps * p.controlled * sizeof(double));
    for (int k = 0; k < p.steps; k++) {
        numbers(file, p.x + k * NX, NX), numbers(file, p.before + k * NU, NU);
        numbers(file, p.reference + k * p.controlled, p.controlled);
    }
    fclose(file);
    return p;
}

/* ------------------------------------------------------------------------------ the solver */

typedef struct {
    const char *qp, *mode;
    double qp_tolerance;
    int cond_n, warm, first, shift;
} settings;

typedef struct {
    ocp_nlp_config *config;
    ocp_nlp_dims *dims;
    ocp_nlp_in *in;
    ocp_nlp_out *out;
    ocp_nlp_solver *solver;
    int *shown; /* the step whose reference a stage has */
} controller;

static void set_dimensions(controller *c, const problem *p) {
    const int count = p->n2 + 1;
    int nx[count], nu[count], none[count];
    for (int i = 0; i < count; i++) nx[i] = NZ, nu[i] = i < p->n2 ? NU : 0, none[i] = 0;
    ocp_nlp_dims_set_opt_vars(c->config, c->dims, "nx", nx);
    ocp_nlp_dims_set_opt_vars(c->config, c->dims, "nu", nu);
    ocp_nlp_dims_set_opt_vars(c->config, c->dims, "nz", none);
    ocp_nlp_dims_set_opt_vars(c->config, c->dims, "ns", none);
    ocp_nlp_dims_set_opt_vars(c->config, c->dims, "np", none);
    for (int i = 0; i < count; i++) {
        int ny = p->controlled + (i < p->n2 ? NU : 0), inputs = i < p->n2 ? NU : 0;
        int states = i == 0 ? NZ : NX, fixed = i == 0 ? NZ : 0;
        ocp_nlp_dims_set_cost(c->config, c->dims, i, "ny", &ny);
        ocp_nlp_dims_set_constraints(c->config, c->dims, i, "nbx", &states);
        ocp_nlp_dims_set_constraints(c->config, c->dims, i, "nbu", &inputs);
        ocp_nlp_dims_set_constraints(c->config, c->dims, i, "nbxe", &fixed);
    }
}

/* The sum of Q-weighted errors and R-weighted increments; acados takes half of each square. The
   error of the measured state is a constant: it is there for shift(), to which all stages look
   alike. */
static void set_cost(controller *c, const problem *p, int stage) {
    const int with_input = stage < p->n2, rows = p->controlled + (with_input ? NU : 0);
    double w[rows * rows], vx[rows * NZ], vu[rows * NU];
    memset(w, 0, sizeof w), memset(vx, 0, sizeof vx), memset(vu, 0, sizeof vu);
    for (int i = 0; i < p->controlled; i++) {
        w[i * rows + i] = 2 * p->q[i];
        vx[p->index[i] * rows + i] = 1.0;
    }
    for (int j = 0; with_input && j < NU; j++) {
        const int row = p->controlled + j;
        w[row * rows + row] = 2 * p->r[j];
        vx[(NX + j) * rows + row] = -1.0;
        vu[j * rows + row] = 1.0;
    }
    ocp_nlp_cost_model_set(c->config, c->dims, c->in, stage, "W", w);
    ocp_nlp_cost_model_set(c->config, c->dims, c->in, stage, "Vx", vx);
    if (with_input) ocp_nlp_cost_model_set(c->config, c->dims, c->in, stage, "Vu", vu);
}

static void set_bounds(controller *c, const problem *p, int stage) {
    int index[NZ];
    for (int i = 0; i < NZ; i++) index[i] = i;
    double low[NZ], high[NZ];
    memcpy(low, p->x_low, sizeof p->x_low), memcpy(high, p->x_high, sizeof p->x_high);
    ocp_nlp_constraints_model_set(c->config, c->dims, c->in, c->out, stage, "idxbx", index);
    if (stage == 0) {
        ocp_nlp_constraints_model_set(c->config, c->dims, c->in, c->out, 0, "idxbxe", index);
    } else {
        ocp_nlp_constraints_model_set(c->config, c->dims, c->in, c->out, stage, "lbx", low);
        ocp_nlp_constraints_model_set(c->config, c->dims, c->in, c->out, stage, "ubx", high);
    }
    if (stage == p->n2) return;
    memcpy(low, p->u_low, sizeof p->u_low), memcpy(high, p->u_high, sizeof p->u_high);
    ocp_nlp_constraints_model_set(c->config, c->dims, c->in, c->out, stage, "idxbu", index);
    ocp_nlp_constraints_model_set(c->config, c->dims, c->in, c->out, stage, "lbu", low);
    ocp_nlp_constraints_model_set(c->config, c->dims, c->in, c->out, stage, "ubu", high);
}

static void *options(controller *c, const settings *s) {
    void *opts = ocp_nlp_solver_opts_create(c->config, c->dims);
    const int hpipm = strcmp(s->qp, "daqp") != 0;
    int off = 0, on = 1, iterations = 50, qp_iterations = hpipm ? 100 : 1000;
    double tolerance = 1e-8, qp_tolerance = s->qp_tolerance;
    int warm = s->warm, cond_n = s->cond_n, first = s->first > 0;
    if (hpipm) ocp_nlp_solver_opts_set(c->config, opts, "qp_hpipm_mode", (void *)s->mode);
    if (cond_n > 0) ocp_nlp_solver_opts_set(c->config, opts, "qp_cond_N", &cond_n);
    const char *tolerances[] = {"tol_stat", "tol_eq", "tol_ineq", "tol_comp"};
    const char *qp_tolerances[] = {"qp_tol_stat", "qp_tol_eq", "qp_tol_ineq", "qp_tol_comp"};
    for (int i = 0; i < 4; i++) {
        ocp_nlp_solver_opts_set(c->config, opts, tolerances[i], &tolerance);
        ocp_nlp_solver_opts_set(c->config, opts, qp_tolerances[i], &qp_tolerance);
    }
    ocp_nlp_solver_opts_set(c->config, opts, "exact_hess", &off);
    ocp_nlp_solver_opts_set(c->config, opts, "fixed_hess", &on);
    ocp_nlp_solver_opts_set(c->config, opts, "print_level", &off);
    ocp_nlp_solver_opts_set(c->config, opts, "max_iter", &iterations);
    ocp_nlp_solver_opts_set(c->config, opts, "qp_iter_max", &qp_iterations);
    ocp_nlp_solver_opts_set(c->config, opts, "qp_warm_start", &warm);
    ocp_nlp_solver_opts_set(c->config, opts, "warm_start_first_qp", &first);
    if (s->first == 2) {
        ocp_nlp_solver_opts_set(c->config, opts, "warm_start_first_qp_from_nlp", &on);
    }
    return opts;
}

static controller create(const problem *p, const settings *s) {
    controller c;
    ocp_nlp_plan_t *plan = ocp_nlp_plan_create(p->n2);
    plan->nlp_solver = SQP;
    plan->globalization = FIXED_STEP;
    plan->ocp_qp_solver_plan.qp_solver = !strcmp(s->qp, "daqp") ? FULL_CONDENSING_DAQP
        : !strcmp(s->qp, "hpipm-full") ? FULL_CONDENSING_HPIPM : PARTIAL_CONDENSING_HPIPM;
    for (int i = 0; i <= p->n2; i++) {
        plan->nlp_cost[i] = LINEAR_LS;
        plan->nlp_constraints[i] = BGH;
        if (i < p->n2) plan->nlp_dynamics[i] = DISCRETE_MODEL;
    }
    c.config = ocp_nlp_config_create(*plan);
    ocp_nlp_plan_destroy(plan);
    c.dims = ocp_nlp_dims_create(c.config);
    set_dimensions(&c, p);
    c.in = ocp_nlp_in_create(c.config, c.dims);
    c.out = ocp_nlp_out_create(c.config, c.dims);
    for (int i = 0; i <= p->n2; i++) {
        set_cost(&c, p, i);
        set_bounds(&c, p, i);
        if (i == p->n2) break;
        ocp_nlp_dynamics_model_set(c.config, c.dims, c.in, i, "disc_dyn_fun", &fun);
        ocp_nlp_dynamics_model_set(c.config, c.dims, c.in, i, "disc_dyn_fun_jac", &fun_jac);
    }
    void *opts = options(&c, s);
    c.solver = ocp_nlp_solver_create(c.config, c.dims, opts, c.in);
    ocp_nlp_precompute(c.solver, c.in, c.out);
    c.shown = malloc((p->n2 + 1) * sizeof(int));
    return c;
}

static const double *reference(const problem *p, int k) {
    const int last = p->steps - 1;
    return p->reference + (k < 0 ? 0 : k > last ? last : k) * p->controlled;
}

/* Stage i has the reference of step k + i - 1. Only what changed is set. */
static void set_references(controller *c, const problem *p, int k) {
    const size_t bytes = p->controlled * sizeof(double);
    for (int i = 0; i <= p->n2; i++) {
        const double *wanted = reference(p, k + i - 1);
        if (c->shown[i] != NEVER && !memcmp(reference(p, c->shown[i]), wanted, bytes)) continue;
        double y[NX + NU] = {0};
        memcpy(y, wanted, bytes);
        ocp_nlp_cost_model_set(c->config, c->dims, c->in, i, "yref", y);
        c->shown[i] = k + i - 1;
    }
}

/* The first guess of a first step, and of one after a failure: the state held, no input, no
   multipliers. */
static void start(controller *c, const problem *p, int k) {
    double z[NZ] = {0};
    memcpy(z, p->x + k * NX, NX * sizeof *z);
    ocp_nlp_solver_reset_qp_memory(c->solver, c->in, c->out);
    ocp_nlp_out_set_values_to_zero(c->config, c->dims, c->out);
    for (int i = 0; i <= p->n2; i++) {
        ocp_nlp_out_set(c->config, c->dims, c->out, c->in, i, "x", z);
        c->shown[i] = NEVER;
    }
}

/* Multipliers are ordered: lower bounds of inputs, of states, upper bounds of inputs, of states.
   Those of the measured state, which is fixed by bounds, are what stage 1 had for being reached and
   for its bounds: so a plan that holds for the next step passes acados' test without a QP. */
static void shift(controller *c, int n2) {
    ocp_nlp_out *out = c->out;
    const double *held = out->lam[1].pa, *reached = out->pi[0].pa;
    double *fixed = out->lam[0].pa;
    for (int j = 0; j < NU; j++) fixed[j] = held[j], fixed[NU + NZ + j] = held[NU + NX + j];
    for (int j = 0; j < NZ; j++) {
        const double force = reached[j] + (j < NX ? held[NU + j] - held[NU + NX + NU + j] : 0.0);
        fixed[NU + j] = force > 0 ? force : 0.0;
        fixed[NU + NZ + NU + j] = force < 0 ? -force : 0.0;
    }
    for (int i = 0; i + 1 < n2; i++) {
        blasfeo_dveccp(NU + NZ, out->ux + i + 1, 0, out->ux + i, 0);
        blasfeo_dveccp(NZ, out->pi + i + 1, 0, out->pi + i, 0);
        if (i > 0) blasfeo_dveccp(2 * (NU + NX), out->lam + i + 1, 0, out->lam + i, 0);
    }
    blasfeo_dveccp(NZ, out->ux + n2, 0, out->ux + n2 - 1, NU);
}

static void run(controller *c, const problem *p, const settings *s, int repetition) {
    int status = 0;
    start(c, p, 0);
    for (int k = 0; k < p->steps; k++) {
        double z[NZ], u[NU];
        const double begun = now_us();
        memcpy(z, p->x + k * NX, NX * sizeof *z);
        memcpy(z + NX, p->before + k * NU, NU * sizeof *z);
        if (status != 0) start(c, p, k);
        else if (k > 0 && s->shift) shift(c, p->n2);
        ocp_nlp_constraints_model_set(c->config, c->dims, c->in, c->out, 0, "lbx", z);
        ocp_nlp_constraints_model_set(c->config, c->dims, c->in, c->out, 0, "ubx", z);
        set_references(c, p, k);
        status = ocp_nlp_solve(c->solver, c->in, c->out);
        ocp_nlp_out_get(c->config, c->dims, c->out, 0, "u", u);
        const double us = now_us() - begun;
        int iterations;
        ocp_nlp_get(c->solver, "sqp_iter", &iterations);
        printf("%d %d %.3f %d %d %.2e", repetition, k, us, status, iterations,
               c->out->inf_norm_res);
        for (int j = 0; j < NU; j++) printf(" %.17g", u[j]);
        printf("\n");
    }
}

int main(int count, char **arguments) {
    if (count != 10) {
        fprintf(stderr, "see the head of driver.c for the nine arguments\n");
        return 1;
    }
    const problem p = read_problem(arguments[1]);
    const settings s = {.qp = arguments[2], .cond_n = atoi(arguments[3]), .mode = arguments[4],
                        .qp_tolerance = atof(arguments[5]), .warm = atoi(arguments[6]),
                        .first = atoi(arguments[7]), .shift = atoi(arguments[8])};
    controller c = create(&p, &s);
    for (int i = 0; i < atoi(arguments[9]); i++) run(&c, &p, &s, i);
    return 0;
}
