"""pinc-qp on the programs of a test set of qpbenchmark, beside other solvers of qpsolvers.

    pip install pinc qpsolvers daqp quadprog clarabel piqp proxsuite scipy
    git clone https://github.com/qpsolvers/mpc_qpbenchmark
    git clone https://github.com/qpsolvers/maros_meszaros_qpbenchmark
    python benches/outside/qpbenchmark.py mpc_qpbenchmark/data OUT.csv
    python benches/outside/qpbenchmark.py maros_meszaros_qpbenchmark/data OUT.csv

Each solver has the settings that qpbenchmark gives it for an accuracy: its tolerance where it has one.
A program counts as solved if the primal residual, the dual residual and the duality gap of the answer
are within the accuracy. Times are CPU times, medians of runs taken in turn; their mean is the geometric
mean of time + 10 s, less 10 s, as in qpbenchmark, where a program that is not solved counts as 1000 s.

Of the Maros-Meszaros test set the dense subset is solved, once: programs with at most 1000 unknowns and
1000 constraints. Each solution is a process of its own, which may take a minute of CPU time.
"""

import csv
import multiprocessing
import resource
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import qpsolvers

import pinc_nmpc.qp

ACCURACIES = (1e-3, 1e-6, 1e-9)
REPETITIONS = 5
LIMIT_S = 60
MOST = 1000
UNSOLVED_S = 1000.0
SHIFT_S = 10.0


def settings(solver, accuracy):
    """The settings of a solver for an accuracy."""
    return {
        "clarabel": {"tol_feas": accuracy, "tol_gap_abs": accuracy, "tol_gap_rel": 0.0},
        "daqp": {"dual_tol": accuracy, "primal_tol": accuracy},
        "piqp": {"check_duality_gap": True, "eps_abs": accuracy, "eps_rel": 0.0,
                 "eps_duality_gap_abs": accuracy, "eps_duality_gap_rel": 0.0},
        "proxqp": {"check_duality_gap": True, "eps_abs": accuracy, "eps_rel": 0.0,
                   "eps_duality_gap_abs": accuracy, "eps_duality_gap_rel": 0.0},
    }.get(solver, {})


def load_mat(path):
    """A program of the Maros-Meszaros test set, None if it is too large; its last rows are bounds."""
    import scipy.io

    data = scipy.io.loadmat(path)
    P, rows = data["P"].astype(float), data["A"].astype(float)
    n = P.shape[0]
    low, high = (data[key].flatten().astype(float) for key in ("l", "u"))
    low[low < -9e19], high[high > 9e19] = -np.inf, np.inf
    equal = high[:-n] - low[:-n] < 1e-10
    h = np.concatenate([high[:-n][~equal], -low[:-n][~equal]])
    if n > MOST or equal.sum() + np.isfinite(h).sum() + n > MOST:
        return None
    rows = rows.toarray()[:-n]
    G = np.vstack([rows[~equal], -rows[~equal]])[np.isfinite(h)]
    parts = G, h[np.isfinite(h)], rows[equal], high[:-n][equal]
    parts = [part if part.size else None for part in parts]
    return qpsolvers.Problem(P.toarray(), data["q"].flatten().astype(float), *parts, low[-n:], high[-n:])


def load(path):
    """A program of the MPC test set; conversions are not timed."""
    data = np.load(path, allow_pickle=True)
    parts = {key: data[key] for key in ("P", "q", "G", "h", "A", "b", "lb", "ub") if key in data}
    return qpsolvers.Problem(**{
        key: None if value.ndim == 0 or value.size == 0 else np.ascontiguousarray(value, float)
        for key, value in parts.items()
    })


def solve(problem, solver, accuracy):
    """Seconds, and the largest of the residuals."""
    begun = time.thread_time()
    try:
        found = qpsolvers.solve_problem(problem, solver, **settings(solver, accuracy))
    except Exception:  # noqa: BLE001: what a solver raises is a program that it did not solve
        return np.inf, np.inf
    seconds = time.thread_time() - begun
    if not found.found:
        return seconds, np.inf
    residuals = found.primal_residual(), found.dual_residual(), found.duality_gap()
    return seconds, max(residuals)


def solve_apart(problem, solver, accuracy):
    """The same in a process that may take LIMIT_S of CPU time."""
    fork = multiprocessing.get_context("fork")
    ours, its = fork.Pipe()

    def run():
        resource.setrlimit(resource.RLIMIT_CPU, (LIMIT_S, LIMIT_S))
        its.send(solve(problem, solver, accuracy))

    process = fork.Process(target=run)
    process.start()
    its.close()
    try:
        return ours.recv()
    except EOFError:
        return LIMIT_S, np.inf
    finally:
        process.join()


def main():
    pinc_nmpc.qp.register()
    warnings.simplefilter("ignore")
    data, out = Path(sys.argv[1]), Path(sys.argv[2])
    problems = {path.stem: load(path) for path in sorted(data.glob("*.npz"))}
    run, repetitions = (solve, REPETITIONS) if problems else (solve_apart, 1)
    dense = ((path.stem, load_mat(path)) for path in sorted(data.glob("*.mat")))
    problems |= {name: problem for name, problem in dense if problem}
    known = ("pinc", "daqp", "quadprog", "piqp", "proxqp", "clarabel")
    solvers = [solver for solver in known if solver in qpsolvers.available_solvers]
    rows = []
    for accuracy in ACCURACIES:
        times = {(solver, name): [] for solver in solvers for name in problems}
        worst = dict.fromkeys(times, 0.0)
        for _ in range(repetitions):
            for name, problem in problems.items():
                for solver in solvers:
                    seconds, residual = run(problem, solver, accuracy)
                    times[solver, name].append(seconds)
                    worst[solver, name] = max(worst[solver, name], residual)
        for solver in solvers:
            solved = [name for name in problems if worst[solver, name] <= accuracy]
            seconds = [
                float(np.median(times[solver, name])) if name in solved else UNSOLVED_S
                for name in problems
            ]
            mean = np.exp(np.mean(np.log(np.array(seconds) + SHIFT_S))) - SHIFT_S
            own = np.array([np.median(times[solver, name]) for name in solved])
            median = 1e6 * np.median(own) if len(own) else np.nan
            largest = max((worst[solver, name] for name in solved), default=np.nan)
            rows.append([solver, f"{accuracy:g}", len(solved), f"{largest:.1e}",
                         f"{median:.0f}", f"{mean:.4g}"])
            print(*rows[-1], flush=True)
            missed = sorted(set(problems) - set(solved))
            if missed and solver == "pinc":
                print("   not solved:", *missed)
    with open(out, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        head = ["solver", "accuracy", "solved", "largest residual", "median (us)", "mean (s)"]
        writer.writerows([head, *rows])


main()
