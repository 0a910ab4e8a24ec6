#!/usr/bin/env python3
"""Does every seed converge? The defaults of preset `ours` on all plants, seed by seed.

    cargo build --release
    python3 benches/training/seeds.py --seeds 0-19

Trains each plant's config once per seed, with its defaults but for an end after `--iterations` iterations and more frequent validations. The budget is one
of iterations and not of time, so that a busy machine finds the same as an idle one; its time is in the table. A seed has converged when the validation error (Eq. mse_gen)
falls below the plant's limit: the error of the authors' nets; for the one tank, whose net they did not publish, 1e-4 cm^2 (0.01 cm). Prints a Markdown table; exit
code 1 if a seed did not converge.
"""

import argparse
import pathlib
import statistics
import sys
import tempfile

from runs import seeds, train, validations

TANKS = "configs/four-tanks/main.toml"

# What is trained, with which settings, and the limit of its validation error.
CASES = [
    ("Van der Pol 4x20", "configs/van-der-pol/main.toml", {}, 1.6e-4),
    ("one tank 3x10", "configs/one-tank/main.toml", {}, 1e-4),
] + [
    (f"four tanks 5x20, `{name}`", TANKS, {"plant.four-tanks.parameters": name}, 3.6e-2)
    for name in ("antonelo", "johansson-nonminimum", "johansson-minimum")
]


def run(args, config, settings, limit, seed):
    """Iterations and seconds to the limit (None if never), best error, seconds and end of one training."""
    settings = settings | {
        "seed": seed,
        "training.phases.0.iterations": args.iterations,
        "training.validation_every": args.validation_every,
    }
    with tempfile.TemporaryDirectory() as folder:
        rows, metrics = train(args.pinc, config, settings, pathlib.Path(folder) / "run")
    below = [row for row, error in validations(rows) if error <= limit]
    reached = (int(below[0]["iteration"]), float(below[0]["elapsed_s"])) if below else None
    best = min(error for _, error in validations(rows))
    return reached, best, metrics["training"]["wall_s"], metrics["training"]["stop_reason"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pinc", default="target/release/pinc", help="the program")
    parser.add_argument("--seeds", type=seeds, default=seeds("0-19"), help="for instance 0-4")
    parser.add_argument("--iterations", type=int, default=1000, help="of each training")
    parser.add_argument("--validation-every", type=int, default=25, help="iterations between validations")
    parser.add_argument("--plant", default="", help="only the cases whose names contain this")
    args = parser.parse_args()

    head = ["plant", "limit", "converged", "iterations to the limit", "s to the limit", f"mse_gen after {args.iterations}", "worst", "s in all"]
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head), flush=True)
    failed = []
    for name, config, settings, limit in (case for case in CASES if args.plant in case[0]):
        results = [(seed, *run(args, config, settings, limit, seed)) for seed in args.seeds]
        failed += [(name, seed, best, reason) for seed, reached, best, _, reason in results if reached is None]
        reached = [reached for _, reached, *_ in results if reached is not None]
        iterations, times = zip(*reached) if reached else ([0], [0.0])
        best = [best for _, _, best, *_ in results]
        total = [wall for *_, wall, _ in results]
        cells = [
            name,
            f"{limit:g}",
            f"{len(reached)} of {len(results)}",
            f"{statistics.median(iterations):g}, at most {max(iterations)}",
            f"{statistics.median(times):.2f}, at most {max(times):.2f}",
            f"{statistics.median(best):.1e}",
            f"{max(best):.1e}",
            f"at most {max(total):.1f}",
        ]
        print("| " + " | ".join(cells) + " |", flush=True)
    for name, seed, best, reason in failed:
        print(f"{name}, seed {seed}: best {best:.2e}, {reason}", file=sys.stderr)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
