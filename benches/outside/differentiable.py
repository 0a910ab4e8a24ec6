"""Plans and their gradients in all parameters, a batch at once, beside acados: the problem of Table 1 of
J. Frey et al., "Differentiable nonlinear model predictive control" (2025).

    git clone https://github.com/acados/acados          # with blasfeo, hpipm; -DACADOS_WITH_OPENMP=ON
    pip install pinc-nmpc casadi scipy acados/interfaces/acados_template
    ACADOS_SOURCE_DIR=acados python benches/outside/differentiable.py [THREADS] [OUT.csv]

A random plant x[k+1] = A x[k] + B u[k] + b with 8 states and 4 inputs, N = 20, |u| <= umax, quadratic
costs, and 128 initial states. Each solver gets the states, solves all problems and hands on the inputs;
with gradients also the gradient of the sum of the first inputs in A, B, b and the matrix of the costs,
248 numbers. acados solves one QP per problem (HPIPM, tolerance 1e-7), as in the paper's script; pinc
starts each controller afresh and ends at KKT residuals of 1e-8. For pinc the plant is the differential
equation x' = M x + N u + c whose RK4 step of 1 s is the plant, and the weight of x[k+1] and u[k] is one
matrix; acados' gradients are converted for the comparison. Products of states and inputs, which the two
pair differently, are not compared.

Prints a row per bound: medians in ms over rounds in turn, and the largest differences relative to the
largest input and gradient.
"""

import os
import sys
import time

# Threads of acados that wait take nothing from pinc's.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import numpy as np
import scipy.linalg
from acados_template import AcadosOcp, AcadosOcpBatchSolver

import casadi as ca
import pinc_nmpc as pinc

N, STATES, INPUTS, BATCH, ROUNDS = 20, 8, 4, 128, 9
RK4 = [1.0, 1.0, 1 / 2, 1 / 6, 1 / 24]


def problem():
    """A, B, b and the initial states."""
    random = np.random.RandomState(42)
    a = np.eye(STATES) + 0.2 * random.randn(STATES, STATES)
    b, offset = random.randn(STATES, INPUTS), random.randn(STATES)
    return a, b, offset, random.randn(BATCH, STATES)


def powers(m):
    return [np.linalg.matrix_power(m, k) for k in range(5)]


def step(m):
    """A of an RK4 step of x' = M x, and the factor of N and c in it."""
    of = powers(m)
    a = sum(c * p for c, p in zip(RK4, of))
    return a, sum(c * p for c, p in zip(RK4[1:], of))


def step_slope(m, direction):
    """The derivatives of the two along a direction of M."""
    of = powers(m)
    slopes = [sum(of[i] @ direction @ of[k - 1 - i] for i in range(k)) for k in range(5)]
    a = sum(c * s for c, s in zip(RK4, slopes))
    return a, sum(c * s for c, s in zip(RK4[1:], slopes))


def equation(a, b, offset):
    """M, N and c whose RK4 step is the plant."""
    m = np.real(scipy.linalg.logm(a))
    for _ in range(20):
        units = np.eye(STATES * STATES).reshape(-1, STATES, STATES)
        jacobian = np.stack([step_slope(m, unit)[0].ravel() for unit in units], axis=1)
        m -= np.linalg.solve(jacobian, (step(m)[0] - a).ravel()).reshape(m.shape)
    factor = step(m)[1]
    return m, np.linalg.solve(factor, b), np.linalg.solve(factor, offset)


def controllers(m, n, c, umax, threads):
    """pinc's batch."""
    outputs = [f"x[{i + 1}]" for i in range(STATES)] + [f"u[{i + 1}]" for i in range(INPUTS)]
    rows = [(f"m{i + 1}", m[i]) for i in range(STATES)] + [(f"n{i + 1}", n[i]) for i in range(STATES)]
    parameters = {name: list(map(float, row)) for name, row in [("c", c), *rows]}
    equations = {
        f"x[{i}]": f"sum(j = 1..n, m{i}[j]*x[j]) + sum(j = 1..m, n{i}[j]*u[j]) + c[{i}]"
        for i in range(1, STATES + 1)
    }
    names = [f"{name}[{i + 1}]" for name, row in parameters.items() for i in range(len(row))]
    config = {
        "name": "table-1",
        "preset": "ours",
        "seed": 1,
        "plant": {
            "expression": {
                "sizes": {"n": STATES, "m": INPUTS},
                "states": ["x[n]"],
                "inputs": ["u[m]"],
                "parameters": parameters,
                "derivatives": equations,
            }
        },
        "domain": {
            "state_low": [-10.0],
            "state_high": [10.0],
            "input_low": [-umax],
            "input_high": [umax],
            "parameters": {name: [-9.0, 9.0] for name in names},
        },
        "control": {
            "models": ["rk4"],
            "step_s": 1.0,
            "rk4_substeps": 1,
            "duration_s": 1.0,
            "initial_state": [0.0],
            "controlled": outputs,
            "n2": N,
            "nu": N,
            "q": np.eye(STATES + INPUTS).tolist(),
            "r": [0.0],
            "input_low": [-umax],
            "input_high": [umax],
            "references": [{"start_s": 0.0, "value": [0.0] * len(outputs)}],
        },
    }
    return pinc.NmpcBatch(config, threads=threads), sorted(names)


def solver(a, b, offset, x, umax, threads):
    """acados' batch, and the values of its parameters."""
    ocp = AcadosOcp()
    model, width = ocp.model, STATES + INPUTS
    model.name = "table_1"
    model.x, model.u = ca.SX.sym("x", STATES), ca.SX.sym("u", INPUTS)
    parts = [("A", a), ("B", b), ("b", offset[:, None]), ("H", np.eye(width))]
    symbols = [ca.SX.sym(name, *value.shape) for name, value in parts]
    values = np.concatenate([value.ravel(order="F") for _, value in parts])
    model.p_global = ca.vertcat(*[ca.vec(symbol) for symbol in symbols])
    ocp.p_global_values = values
    a, b, offset, h = symbols
    model.disc_dyn_expr = a @ model.x + b @ model.u + offset
    both = ca.vertcat(model.x, model.u)
    ocp.cost.cost_type = ocp.cost.cost_type_e = "EXTERNAL"
    model.cost_expr_ext_cost = ca.bilin(h, both, both)
    model.cost_expr_ext_cost_e = ca.bilin(h[:STATES, :STATES], model.x, model.x)
    ocp.constraints.idxbu = np.arange(INPUTS)
    ocp.constraints.lbu, ocp.constraints.ubu = -umax * np.ones(INPUTS), umax * np.ones(INPUTS)
    ocp.constraints.x0 = x
    options = ocp.solver_options
    options.N_horizon, options.tf = N, N
    options.integrator_type = "DISCRETE"
    options.qp_solver = "PARTIAL_CONDENSING_HPIPM"
    options.hessian_approx = "EXACT"
    options.with_solution_sens_wrt_params = options.with_batch_functionality = True
    options.nlp_solver_type, options.nlp_solver_max_iter, options.tol = "SQP", 1, 1e-7
    made = AcadosOcpBatchSolver(
        ocp, N_batch_init=BATCH, num_threads_in_batch_solve=threads, verbose=False
    )
    return made, values


def solve(batch, values, states, gradient):
    for one, x in zip(batch.ocp_solvers, states):
        one.set(0, "lbx", x)
        one.set(0, "ubx", x)
        one.set_p_global_and_precompute_dependencies(values)
    batch.solve()
    inputs = batch.get_flat("u").reshape(BATCH, N, INPUTS)
    if not gradient:
        return inputs, None
    batch.setup_qp_matrices_and_factorize()
    seed = np.ones((BATCH, INPUTS, 1))
    found = batch.eval_adjoint_solution_sensitivity(
        seed_x=None, seed_u=[(0, seed)], sanity_checks=False
    )
    return inputs, np.sum(found, axis=0).ravel()


def converted(gradient, m, n, c):
    """acados' gradient in A, B, b as the one in M, N, c; and in the costs of states and of inputs."""
    sizes = [STATES**2, STATES * INPUTS, STATES]
    by_a, by_b, by_offset, by_h = np.split(gradient, np.cumsum(sizes))
    by_a, by_b = by_a.reshape(STATES, STATES).T, by_b.reshape(INPUTS, STATES).T
    by_m = np.zeros((STATES, STATES))
    for i, k in np.ndindex(by_m.shape):
        unit = np.zeros((STATES, STATES))
        unit[i, k] = 1.0
        a, factor = step_slope(m, unit)
        by_m[i, k] = np.sum(by_a * a) + np.sum(by_b * (factor @ n)) + by_offset @ (factor @ c)
    factor = step(m)[1]
    by_h = by_h.reshape(STATES + INPUTS, STATES + INPUTS)
    return [by_m, factor.T @ by_b, factor.T @ by_offset, *diagonal_blocks(by_h)]


def diagonal_blocks(by_h):
    by_h = 0.5 * (by_h + by_h.T)
    return [by_h[:STATES, :STATES], by_h[STATES:, STATES:]]


def own(values, names):
    """The same of pinc's gradients."""
    sums = dict(zip(names, np.sum(values["parameters"], axis=0)))
    rows = range(1, STATES + 1)
    by_m = np.array([[sums[f"m{i}[{k}]"] for k in rows] for i in rows])
    by_n = np.array([[sums[f"n{i}[{k + 1}]"] for k in range(INPUTS)] for i in rows])
    by_c = np.array([sums[f"c[{i}]"] for i in rows])
    width = STATES + INPUTS
    return [by_m, by_n, by_c, *diagonal_blocks(np.sum(values["q"], axis=0).reshape(width, width))]


def median_ms(programs):
    """The median time of each, in turns."""
    times = [[] for _ in programs]
    for _ in range(ROUNDS):
        for program, taken in zip(programs, times):
            begin = time.perf_counter()
            program()
            taken.append(1e3 * (time.perf_counter() - begin))
    return [np.median(taken) for taken in times]


def main():
    threads = int(sys.argv[1]) if len(sys.argv) > 1 else os.cpu_count()
    a, b, offset, states = problem()
    m, n, c = equation(a, b, offset)
    head = (
        "umax,plans by PINC,plans by acados,with gradients by PINC,with gradients by acados,"
        "inputs differ by,gradients differ by"
    )
    lines = [head]
    for umax in (1e4, 1.0):
        batch, names = controllers(m, n, c, umax, threads)
        acados, values = solver(a, b, offset, states[0], umax, threads)
        zero = [0.0] * (STATES + INPUTS)
        ours = batch.gradients(states, zero, by_inputs=[1.0] * INPUTS)
        inputs, gradient = solve(acados, values, states, True)
        assert set(ours.steps.status) == {"converged"} and set(ours.regularity) <= {"regular", "kink"}
        off = abs(ours.steps.u - inputs[:, 0]).max() / abs(inputs).max()
        pairs = list(zip(own(ours.values, names), converted(gradient, m, n, c)))
        largest = max(abs(found).max() for _, found in pairs)
        differ = max(abs(found - expected).max() for found, expected in pairs) / largest
        times = median_ms([
            lambda: batch.steps(states, zero),
            lambda: solve(acados, values, states, False),
            lambda: batch.gradients(states, zero, by_inputs=[1.0] * INPUTS),
            lambda: solve(acados, values, states, True),
        ])
        numbers = ",".join(f"{ms:.1f}" for ms in times)
        lines.append(f"{umax:g},{numbers},{off:.1e},{differ:.1e}")
        print(head, lines[-1], sep="\n", flush=True)
    if len(sys.argv) > 2:
        with open(sys.argv[2], "w", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
