"""Moving horizon estimation over recorded data by CasADi, and how many times faster pinc is.

    cargo build --release
    python benches/peers/casadi_mhe.py [--pinc target/release/pinc] [--rounds 3] [--window 10]

Both estimate from the same data with the same tuning, RK4 x4 as the model, to a residual of 1e-8: CasADi
by its SQP method with Hessians of Gauss and Newton and the QP solver `qrqp`, from the window of the step
before. That they find the same states is checked. The rows without a peer are pinc's filters, beside an
extended Kalman filter in NumPy with the model and its Jacobian from CasADi.
"""

import argparse
import csv
import re
import statistics
import subprocess
import tempfile
import time
import tomllib
from pathlib import Path

import casadi as ca
import numpy as np

from casadi_nmpc import four_tanks, rk4, van_der_pol

TOP = Path(__file__).resolve().parents[2]
CASES = {"four tanks": (four_tanks, "recorded-tanks", "estim-tanks", ["h1", "h2", "h3", "h4"]),
         "oscillator": (van_der_pol, "recorded-oscillator", "estim-vdp", ["x1", "x2"])}


def columns(path, names):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    return np.array([[float(row[name]) for name in names] for row in rows])


def pinc(program, config, data, kind, window, states, folder):
    """pinc's median time of a step in us, and its estimates."""
    out = folder / "estimates.csv"
    command = [program, "estimate", str(config), "--data", str(data), "--output", str(out),
               "--set", f"control.estimator.kind={kind}"]
    if kind == "mhe":
        command += ["--set", f"control.estimator.window={window}"]
    said = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return float(re.search(r"([0-9.]+) us a step", said).group(1)), columns(out, states)


class Problem:
    """The tuning of a config, the model, and the solvers of windows, which are built once."""

    def __init__(self, rhs, config, states, window):
        control = tomllib.loads(config.read_text())["control"]
        tuning = control["estimator"]
        self.n, self.window = len(states), window
        self.m = len(control["input_low"])
        self.model = rk4(rhs, self.n, self.m, control["step_s"])
        x, u = ca.SX.sym("x", self.n), ca.SX.sym("u", self.m)
        self.a = ca.Function("a", [x, u], [ca.jacobian(self.model(x, u), x)])
        self.h = np.array([[float(name == state) for state in states]
                           for name in control["measurement"]["measured"]])
        self.start = np.array(tuning["initial_estimate"])
        self.p = np.diag(np.square(tuning["initial_sd"]))
        self.q_sd, self.r_sd = (np.array(tuning[key]) for key in ["process_sd", "measurement_sd"])
        self.solvers = [self.solver(steps) for steps in range(window + 1)]

    def solver(self, steps):
        x = ca.SX.sym("x", self.n, steps + 1)
        prior, root = ca.SX.sym("prior", self.n), ca.SX.sym("root", self.n, self.n)
        u, y = ca.SX.sym("u", self.m, steps), ca.SX.sym("y", len(self.h), steps + 1)
        rest = [root @ (x[:, 0] - prior)]
        for j in range(steps + 1):
            rest.append((y[:, j] - self.h @ x[:, j]) / self.r_sd)
        for j in range(steps):
            rest.append((x[:, j + 1] - self.model(x[:, j], u[:, j])) / self.q_sd)
        rest, z = ca.vertcat(*rest), ca.vec(x)
        p = ca.vertcat(prior, ca.vec(root), ca.vec(u), ca.vec(y))
        jacobian = ca.jacobian(rest, z)
        lam_f, lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", 0)
        gauss_newton = ca.Function("gauss_newton", [z, p, lam_f, lam_g],
                                   [lam_f * ca.mtimes(jacobian.T, jacobian)],
                                   ["x", "p", "lam_f", "lam_g"], ["hess_gamma_x_x"])
        options = {"qpsol": "qrqp", "print_header": False, "print_iteration": False,
                   "print_status": False, "print_time": False, "tol_du": 1e-8,
                   "hess_lag": gauss_newton, "max_iter_ls": 0,
                   "qpsol_options": {"print_iter": False, "print_header": False,
                                     "error_on_fail": False}}
        return ca.nlpsol("mhe", "sqpmethod", {"x": z, "p": p, "f": ca.sumsqr(rest) / 2}, options)

    def correct(self, p):
        """The gain and the covariance after a correction."""
        s = self.h @ p @ self.h.T + np.diag(self.r_sd ** 2)
        k = np.linalg.solve(s, self.h @ p).T
        rest = np.eye(self.n) - k @ self.h
        return k, rest @ p @ rest.T + k @ np.diag(self.r_sd ** 2) @ k.T

    def predict(self, z, p, u):
        a = self.a(z, u).full()
        return self.model(z, u).full().ravel(), a @ p @ a.T + np.diag(self.q_sd ** 2)

    def filter(self, us, ys):
        """Times in us and estimates of the extended Kalman filter."""
        z, p, times, found = self.start, self.p, [], []
        for u, y in zip(us, ys):
            start = time.perf_counter()
            k, p = self.correct(p)
            z = z + k @ (y - self.h @ z)
            found.append(z)
            z, p = self.predict(z, p, u)
            times.append(1e6 * (time.perf_counter() - start))
        return times, np.array(found)

    def estimate(self, us, ys):
        """Times in us at the full window, and estimates."""
        z, p, priors, guess = self.start, self.p, [], np.zeros((0, self.n))
        times, found = [], []
        for k, (u, y) in enumerate(zip(us, ys)):
            first = max(k - self.window, 0)
            priors.append((z, p))
            priors, guess = priors[-self.window - 1:], np.vstack([guess, z])[-self.window - 1:]
            start = time.perf_counter()
            gain, p = self.correct(p)
            guess[-1] += gain @ (y - self.h @ z)
            prior, covariance = priors[0]
            root = np.linalg.inv(np.linalg.cholesky(covariance))
            parameters = np.concatenate([prior, root.ravel(order="F"), us[first:k].ravel(),
                                         ys[first:k + 1].ravel()])
            solver = self.solvers[k - first]
            guess = solver(x0=guess.ravel(), p=parameters)["x"].full().reshape(-1, self.n)
            if not solver.stats()["success"]:
                raise SystemExit(f"CasADi: {solver.stats()['return_status']}")
            found.append(guess[-1].copy())
            z, p = self.predict(guess[-1], p, u)
            if k >= self.window:
                times.append(1e6 * (time.perf_counter() - start))
        return times, np.array(found)


def compare(name, arguments, folder):
    rhs, config, data, states = CASES[name]
    config = TOP / f"configs/estimation/{config}.toml"
    data = TOP / f"crates/pinc-estimate/tests/data/{data}.csv"
    problem = Problem(rhs, config, states, arguments.window)
    control = tomllib.loads(config.read_text())["control"]
    us = columns(data, ["u1", "u2"] if problem.m == 2 else ["u"])
    ys = columns(data, [f"y_{name}" for name in control["measurement"]["measured"]])
    peers = {"ekf": problem.filter, "ukf": None, "mhe": problem.estimate}
    for kind, peer in peers.items():
        ours, theirs, apart = [], [], 0.0
        for _ in range(arguments.rounds):
            time_us, found = pinc(arguments.pinc, config, data, kind, arguments.window, states,
                                  folder)
            ours.append(time_us)
            if peer:
                times, expected = peer(us, ys)
                theirs.append(statistics.median(times))
                apart = np.max(np.abs(found - expected))
        mine = min(ours)
        if apart > 1e-5:
            raise SystemExit(f"{name}, {kind}: the estimates differ by {apart:.1e}")
        if not theirs:
            print(f"| {name} | {kind} | {mine:.2f} | | | |")
            continue
        what = "NumPy" if kind == "ekf" else "CasADi"
        print(f"| {name} | {kind} | {mine:.2f} | {what} {min(theirs):.0f} "
              f"| {min(theirs) / mine:.0f} | {apart:.0e} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pinc", default=str(TOP / "target/release/pinc"))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--window", type=int, default=10)
    arguments = parser.parse_args()
    print("| data | estimator | pinc us | peer us | times faster | estimates differ by |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name in CASES:
            compare(name, arguments, Path(folder))


if __name__ == "__main__":
    main()
