#!/usr/bin/env python3
"""Validation error over training time, medians over seeds.

    cargo build --release
    python3 benches/training/convergence.py configs/van-der-pol/main.toml --authors 1.6e-4 --seeds 0-4 --times 5,12,45

Trains the config once per seed with `pinc train` until the last of the times, and reads `training.csv`: the error at a time is the best
`validation_mse` (Eq. mse_gen) found until then, as the best net is the one kept. Prints a Markdown table. Needs Python's standard library
only. Nothing else should run on the machine.
"""

import argparse
import math
import pathlib
import statistics
import tempfile

from runs import seeds, train, validations


def errors(args, seed, folder):
    """One training; its (elapsed_s, validation_mse) pairs."""
    settings = {
        "seed": seed,
        "training.time_limit_s": max(args.times) + 1.0,
        "training.validation_every": args.validation_every,
        "training.phases.0.iterations": 1_000_000,
    }
    rows, _ = train(args.pinc, args.config, settings, pathlib.Path(folder) / f"seed-{seed}")
    return [(float(row["elapsed_s"]), error) for row, error in validations(rows)]


def best_until(pairs, time_s):
    return min((error for elapsed, error in pairs if elapsed <= time_s), default=math.inf)


def time_to(pairs, error):
    return next((elapsed for elapsed, found in pairs if found <= error), math.inf)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config")
    parser.add_argument("--pinc", default="target/release/pinc", help="the program")
    parser.add_argument("--seeds", type=seeds, default=seeds("0-4"), help="for instance 0-4")
    parser.add_argument("--times", type=lambda t: [float(v) for v in t.split(",")], default=[5.0, 12.0, 45.0], help="in s")
    parser.add_argument("--authors", type=float, required=True, help="validation error of the authors' net")
    parser.add_argument("--validation-every", type=int, default=50, help="iterations between validations")
    args = parser.parse_args()

    head = ["seed", f"s to {args.authors:g}"] + [f"mse_gen at {t:g} s" for t in args.times]
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head), flush=True)
    columns = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in args.seeds:
            pairs = errors(args, seed, folder)
            row = [time_to(pairs, args.authors)] + [best_until(pairs, t) for t in args.times]
            columns.append(row)
            print(f"| {seed} | {row[0]:.2f} | " + " | ".join(f"{v:.1e}" for v in row[1:]) + " |", flush=True)
    median = [statistics.median(column) for column in zip(*columns)]
    print(f"| median | {median[0]:.2f} | " + " | ".join(f"{v:.1e}" for v in median[1:]) + " |")


if __name__ == "__main__":
    main()
