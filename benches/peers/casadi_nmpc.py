"""The paper's two closed loops solved by CasADi, step by step, and how many times faster pinc is.

    cargo build --release
    python benches/peers/casadi_nmpc.py [--pinc target/release/pinc] [--rounds 3] [--training-s 5]

Each round runs pinc's loop and then gives CasADi the same states, one step after the other. Both solve the
same problem, to a KKT residual of 1e-8, from the plan of the step before; that they find the same inputs
is checked.
"""

import argparse
import csv
import json
import statistics
import subprocess
import tempfile
import time
import tomllib
from pathlib import Path

import casadi as ca
import numpy as np
from safetensors import safe_open

TOP = Path(__file__).resolve().parents[2]
HORIZON = 5
SUBSTEPS = 4


def van_der_pol(x, u):
    return ca.vertcat(x[1], (1 - x[0] ** 2) * x[1] - x[0] + u[0])


def four_tanks(h, u):
    a1, a2, area1, area2 = 0.071, 0.057, 28.0, 32.0
    gamma, k = (0.5, 0.5), (3.33, 3.35)
    out = [a * ca.sqrt(2 * 981.0 * h[i]) for i, a in enumerate((a1, a2, a1, a2))]
    return ca.vertcat((gamma[0] * k[0] * u[0] + out[2] - out[0]) / area1,
                      (gamma[1] * k[1] * u[1] + out[3] - out[1]) / area2,
                      ((1 - gamma[1]) * k[1] * u[1] - out[2]) / area1,
                      ((1 - gamma[0]) * k[0] * u[0] - out[3]) / area2)


PLANTS = {"van-der-pol": (van_der_pol, 0.5), "four-tanks": (four_tanks, 10.0)}


def rk4(rhs, states, inputs, horizon_s):
    """One step of T of the model `rk4`."""
    x0, u = ca.SX.sym("x", states), ca.SX.sym("u", inputs)
    h, x = horizon_s / SUBSTEPS, x0
    for _ in range(SUBSTEPS):
        k1 = rhs(x, u)
        k2 = rhs(x + h / 2 * k1, u)
        k3 = rhs(x + h / 2 * k2, u)
        k4 = rhs(x + h * k3, u)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("rk4", [x0, u], [x])


def net(path):
    """One step of T of the net in a model file."""
    with safe_open(path, framework="numpy") as file:
        model = json.loads(file.metadata()["model"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}
    layers = len(tensors) // 2
    states, inputs = len(model["states"]), len(model["inputs"])
    x0, u = ca.SX.sym("x", states), ca.SX.sym("u", inputs)
    horizon_s = model["horizon_s"]
    z = ca.vertcat(horizon_s, x0, u)
    z = (z - ca.DM(model["input_mean"])) / ca.DM(model["input_std"])
    for i in range(layers):
        z = ca.DM(tensors[f"layers.{i}.weight"]) @ z + ca.DM(tensors[f"layers.{i}.bias"])
        if i + 1 < layers:
            z = ca.tanh(z)
    d = ca.DM(model["output_mean"]) + ca.DM(model["output_std"]) * z
    after = {"direct": d, "hard-linear": x0 + d}[model["ansatz"]]
    return ca.Function("net", [x0, u], [after])


class Problem:
    """Multiple shooting over five steps, as in the paper, with solvers that are built once."""

    def __init__(self, model, control):
        n, m = model.size1_in(0), model.size1_in(1)
        self.n, self.m = n, m
        x = ca.SX.sym("x", n, HORIZON)
        u = ca.SX.sym("u", m, HORIZON)
        x0, before = ca.SX.sym("x0", n), ca.SX.sym("before", m)
        reference = ca.SX.sym("reference", 2, HORIZON)
        cost, gaps, last, moved = 0, [], x0, before
        for j in range(HORIZON):
            gaps.append(model(last, u[:, j]) - x[:, j])
            error, change = x[:2, j] - reference[:, j], u[:, j] - moved
            cost += 10 * ca.dot(error, error) + ca.dot(change, change)
            last, moved = x[:, j], u[:, j]
        z = ca.vertcat(ca.vec(x), ca.vec(u))
        p = ca.vertcat(x0, before, ca.vec(reference))
        nlp = {"x": z, "p": p, "f": cost, "g": ca.vertcat(*gaps)}
        self.low = control["state_low"] * HORIZON + control["input_low"] * HORIZON
        self.high = control["state_high"] * HORIZON + control["input_high"] * HORIZON
        quiet = {"print_time": False}
        ipopt = {"print_level": 0, "sb": "yes", "tol": 1e-9, "bound_relax_factor": 0.0,
                 "warm_start_init_point": "yes", "mu_init": 1e-6,
                 "warm_start_bound_push": 1e-8, "warm_start_mult_bound_push": 1e-8}
        # The Hessian of Gauss and Newton, as pinc's.
        lam_f, lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", n * HORIZON)
        hessian, _ = ca.hessian(cost, z)
        gauss_newton = ca.Function("gauss_newton", [z, p, lam_f, lam_g],
                                   [lam_f * hessian],
                                   ["x", "p", "lam_f", "lam_g"], ["hess_gamma_x_x"])
        sqp = {"qpsol": "qrqp", "print_header": False, "print_iteration": False,
               "print_status": False, "tol_pr": 1e-8, "tol_du": 1e-8, "hess_lag": gauss_newton,
               "max_iter_ls": 0,
               "qpsol_options": {"print_iter": False, "print_header": False,
                                 "error_on_fail": False}}
        self.solvers = {
            "ipopt": ca.nlpsol("ipopt", "ipopt", nlp, {**quiet, "ipopt": ipopt}),
            "sqpmethod": ca.nlpsol("sqpmethod", "sqpmethod", nlp, {**quiet, **sqp}),
        }

    def shift(self, values, width):
        return np.concatenate([values[width:], values[-width:]])

    def loop(self, name, states, inputs, windows):
        """Times in us and inputs for the states of a run, each from the plan of the one before."""
        solver, times, found = self.solvers[name], [], []
        count = self.n * HORIZON
        z = np.concatenate([np.tile(states[0], HORIZON), np.zeros(self.m * HORIZON)])
        lam_x, lam_g = np.zeros(z.size), np.zeros(count)
        before = np.zeros(self.m)
        for x0, u, window in zip(states, inputs, windows):
            p = np.concatenate([x0, before, window])
            start = time.perf_counter()
            result = solver(x0=z, lam_x0=lam_x, lam_g0=lam_g, p=p, lbx=self.low, ubx=self.high,
                            lbg=0, ubg=0)
            times.append(1e6 * (time.perf_counter() - start))
            if not solver.stats()["success"]:
                raise SystemExit(f"{name}: {solver.stats()['return_status']}")
            plan, mu = result["x"].full().ravel(), result["lam_x"].full().ravel()
            found.append(plan[count:count + self.m])
            z = np.concatenate([self.shift(plan[:count], self.n), self.shift(plan[count:], self.m)])
            lam_x = np.concatenate([self.shift(mu[:count], self.n), self.shift(mu[count:], self.m)])
            lam_g = self.shift(result["lam_g"].full().ravel(), self.n)
            before = u
        return times, np.array(found)


def read(path):
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    return rows[0], rows[1:]


def pinc(program, config, arguments, out):
    """pinc's loop: median time of a step in us, and states, inputs and references at the steps."""
    command = [program, "control", str(config), "--quiet", "--out", str(out), *arguments]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    header, rows = read(out / "steps.csv")
    us = statistics.median(float(row[header.index("solve_us")]) for row in rows)
    header, rows = read(out / "control.csv")
    rows = np.array(rows, dtype=float)
    m = len([name for name in header if name.startswith("u")])
    n = len(header) - 1 - m - 2
    states = rows[:-1:9, 1:1 + n]
    inputs = rows[1::9, 1 + n:1 + n + m]
    return us, states, inputs, rows[1::9, 1 + n + m:]


def windows(references):
    """The references over the horizon at each step; at the end, the last five."""
    last = len(references) - HORIZON
    return [references[min(k, last):min(k, last) + HORIZON].ravel() for k in range(len(references))]


def compare(plant, arguments, folder):
    rhs, horizon_s = PLANTS[plant]
    config = TOP / "configs" / plant / "control.toml"
    control = tomllib.loads(config.read_text())["control"]
    model_file = folder / f"{plant}.safetensors"
    trained = folder / f"{plant}-training"
    command = [arguments.pinc, "train", str(config), "--quiet", "--out", str(trained),
               "--set", f"training.time_limit_s={arguments.training_s:.1f}"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    (trained / "model.safetensors").rename(model_file)
    n, m = len(control["state_low"]), len(control["input_low"])
    cases = {"rk4": (rk4(rhs, n, m, horizon_s), ["--only", "rk4"]),
             "pinc": (net(model_file), ["--only", "pinc", "--model", str(model_file)])}
    for name, (model, flags) in cases.items():
        problem = Problem(model, control)
        ours, theirs, apart = [], {key: [] for key in problem.solvers}, {}
        for round in range(arguments.rounds):
            out = folder / f"{plant}-{name}-{round}"
            us, states, inputs, references = pinc(arguments.pinc, config, flags, out)
            ours.append(us)
            for key in problem.solvers:
                times, found = problem.loop(key, states, inputs, windows(references))
                theirs[key].append(statistics.median(times))
                apart[key] = np.max(np.abs(found - inputs))
        mine = statistics.median(ours)
        print(f"| {plant}, {name} | pinc | {mine:.1f} | | |")
        for key, times in theirs.items():
            ratio = statistics.median(other / own for own, other in zip(ours, times))
            print(f"| {plant}, {name} | CasADi {key} | {statistics.median(times):.0f} "
                  f"| {ratio:.0f} | {apart[key]:.0e} |", flush=True)
            if apart[key] > arguments.tolerance:
                raise SystemExit(f"the inputs differ by {apart[key]:.1e}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pinc", default=str(TOP / "target/release/pinc"))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--training-s", type=float, default=5.0)
    parser.add_argument("--tolerance", type=float, default=1e-4)
    arguments = parser.parse_args()
    print("| loop, model | program | median step, us | times as long | inputs differ by |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for plant in PLANTS:
            compare(plant, arguments, Path(folder))


if __name__ == "__main__":
    main()
