#!/usr/bin/env python3
"""What the steps of a closed loop take: the first one, the median, the 99th percentile, the longest.

    cargo build --release
    python3 benches/control/work.py

Runs each loop with Runge-Kutta as the model, several times, and prints a Markdown table of its
steps.csv. The first step of a loop has no plan to start from; the others are those after it. Times
are medians over the repetitions of each step; all else is counted.
"""

import argparse
import csv
import pathlib
import subprocess
import tempfile


def longer(config, stages):
    return (config, ["control.n2=%d" % stages, "control.nu=%d" % stages])


LOOPS = {
    "oscillator": ("configs/van-der-pol/control.toml", []),
    "oscillator, N = 80": longer("configs/van-der-pol/control.toml", 80),
    "oscillator, N = 160": longer("configs/van-der-pol/control.toml", 160),
    "tanks": ("configs/four-tanks/control.toml", []),
    "tanks, six stages": ("configs/four-tanks/few-stages.toml", []),
    "tanks, N = 20": longer("configs/four-tanks/control.toml", 20),
    "tanks, N = 40": longer("configs/four-tanks/control.toml", 40),
    "tanks, N = 80": longer("configs/four-tanks/control.toml", 80),
    "cart and pole": ("configs/gallery/cart-pole.toml", []),
    "stirred tank reactor": ("configs/gallery/cstr.toml", []),
    "predators and prey": ("configs/gallery/lotka-volterra.toml", []),
    "arm": ("configs/costly/arm.toml", []),
    "still": ("configs/costly/still.toml", []),
}

COLUMNS = [
    ("us", "solve_us"),
    ("programs", "sqp_iterations"),
    ("stages linearized", "linearized"),
    ("factorizations", "factorizations"),
    ("changes of active constraints", "active_changes"),
]


def steps(program, config, changes, repetitions):
    """The rows of the loop's steps.csv."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "run"
        command = [program, "control", config, "--only", "rk4", "--out", str(out)]
        for change in [*changes, "control.repetitions=%d" % repetitions]:
            command += ["--set", change]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        with open(out / "steps.csv") as file:
            return list(csv.DictReader(file))


def ranks(values):
    """Median, 99th percentile and largest."""
    values = sorted(values)
    return [values[-(-percent * len(values) // 100) - 1] for percent in (50, 99, 100)]


def cell(rows, column):
    first, *rest = [float(row[column]) for row in rows]
    return " / ".join("%.4g" % value for value in [first, *ranks(rest)])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", default="target/release/pinc")
    parser.add_argument("--repetitions", type=int, default=9)
    parser.add_argument("--counts", action="store_true", help="without times: the same on every machine")
    parser.add_argument("--loops", help="only those whose name contains this")
    arguments = parser.parse_args()
    columns = COLUMNS[1:] if arguments.counts else COLUMNS
    print("| loop | " + " | ".join(name for name, _ in columns) + " |")
    print("|---" * (len(columns) + 1) + "|")
    for name, (config, changes) in LOOPS.items():
        if arguments.loops is None or arguments.loops in name:
            rows = steps(arguments.program, config, changes, arguments.repetitions)
            cells = [cell(rows, column) for _, column in columns]
            print("| " + " | ".join([name, *cells]) + " |", flush=True)


if __name__ == "__main__":
    main()
