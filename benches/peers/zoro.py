"""Solves the first plan of a config with a tube by IPOPT, until the tightened bounds stay: multiple
shooting, classical RK4 with the substeps given, random deviations and a constant feedback. (Y. Gao et
al., ECC 2023: the example `diff_drive` of acados.)

    python zoro.py ../../configs/robust/differential-drive.toml > ../../crates/pinc/tests/suite/zoro.json

Prints the inputs of the plan, and by how much the bounds of states and outputs moved at each stage.
"""

import json
import sys
import tomllib
from statistics import NormalDist

import casadi as ca
import numpy as np
from casadi_cost import evaluate, model, step

SUBSTEPS = 4


def listed(bounds, names):
    if isinstance(bounds, list):
        return np.array(bounds)
    return np.array([bounds.get(name, np.nan) for name in names])


def main():
    with open(sys.argv[1], "rb") as file:
        config = tomllib.load(file)
    plant, control = config["plant"]["expression"], config["control"]
    uncertainty = control["uncertainty"]
    states = [state["name"] for state in plant["states"]]
    inputs = [u["name"] for u in plant["inputs"]]
    outputs = sorted(plant["outputs"])
    n, m, N, T = len(states), len(inputs), control["n2"], control["step_s"]
    assert control["controlled"] == states + inputs and not any(control["r"])
    control["cost"] = {}
    f, _, bounded = model(config)
    F = step(f, n, m, T, SUBSTEPS)
    x, u = ca.MX.sym("x", n), ca.MX.sym("u", m)
    following = F(x, u, 0)[0]
    A = ca.Function("A", [x, u], [ca.jacobian(following, x)])
    B = ca.Function("B", [x, u], [ca.jacobian(following, u)])
    y = bounded(x, u)
    C = ca.Function("C", [x, u], [ca.jacobian(y, x)])

    X, U = ca.MX.sym("X", n, N), ca.MX.sym("U", m, N)
    x0, q = np.array(control["initial_state"]), np.array(control["q"])
    ends = ca.horzcat(x0, X)
    objective, defects, held = 0, [], []
    for j in range(N):
        defects.append(F(ends[:, j], U[:, j], 0)[0] - ends[:, j + 1])
        held.append(bounded(ends[:, j + 1], U[:, j]))
        texts = control["references"]
        reference = [evaluate(str(texts[name]), {"t": (j + 1) * T}) for name in control["controlled"]]
        off = ca.vertcat(ends[:, j + 1], U[:, j]) - ca.DM(reference)
        objective += ca.sum1(ca.DM(q) * off**2)
    program = {
        "x": ca.vertcat(ca.vec(X), ca.vec(U)),
        "f": objective,
        "g": ca.vertcat(*defects, *held),
    }
    quiet = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes"}
    tight = {"ipopt.tol": 1e-12, "ipopt.bound_relax_factor": 0.0, "ipopt.mu_target": 1e-13}
    solver = ca.nlpsol("plan", "ipopt", program, quiet | tight)

    gamma = NormalDist().inv_cdf(uncertainty["probability"])
    W = np.diag(np.array(uncertainty["process_sd"]) ** 2)
    K = np.array(uncertainty["feedback"])
    low = np.nan_to_num(listed(control["state_low"], states), nan=-np.inf)
    high = np.nan_to_num(listed(control["state_high"], states), nan=np.inf)
    y_low = listed(control["output_low"], outputs)
    by_x, by_y = np.zeros((N, n)), np.zeros((N, len(outputs)))
    guess = np.concatenate([np.tile(x0, N), np.zeros(m * N)])
    for _ in range(100):
        lower = np.concatenate([(low + by_x).ravel(), np.tile(control["input_low"], N)])
        upper = np.concatenate([(high - by_x).ravel(), np.tile(control["input_high"], N)])
        g_low = np.concatenate([np.zeros(n * N), (y_low + by_y).ravel()])
        g_high = np.concatenate([np.zeros(n * N), np.full(by_y.size, np.inf)])
        found = solver(x0=guess, lbx=lower, ubx=upper, lbg=g_low, ubg=g_high)
        guess = found["x"].full().ravel()
        plan, moves = np.vstack([x0, guess[: n * N].reshape(N, n)]), guess[n * N :].reshape(N, m)
        P, before = np.zeros((n, n)), (by_x.copy(), by_y.copy())
        for j in range(N):
            M = A(plan[j], moves[j]).full() + B(plan[j], moves[j]).full() @ K
            P = M @ P @ M.T + W
            by_x[j] = gamma * np.sqrt(np.diag(P))
            c = C(plan[j + 1], moves[j]).full()
            by_y[j] = gamma * np.sqrt(np.diag(c @ P @ c.T))
        if max(abs(by_x - before[0]).max(), abs(by_y - before[1]).max()) < 1e-11:
            break
    answer = {
        "status": solver.stats()["return_status"],
        "inputs": guess[n * N :].tolist(),
        "states_by": by_x.ravel().tolist(),
        "outputs_by": by_y.ravel().tolist(),
    }
    print(json.dumps(answer))


main()
