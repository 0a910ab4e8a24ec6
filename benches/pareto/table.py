"""The table of a sweep with [one_step], as Markdown: python3 benches/pareto/table.py runs/servo-pareto

Errors of one step are in widths of the training domain, times are medians. Needs Python alone.
"""

import csv
import sys
from pathlib import Path

HEADS = (
    "model",
    "rms",
    "median",
    "99 %",
    "Jacobians",
    "alone, ns",
    "with Jacobians, ns",
    "IAE",
    "control step, us",
    "training, s",
)


def error(text):
    return f"{float(text):.1e}" if text not in ("", "NaN", "inf") else "not finite"


def row(case, result, time, model):
    """The cells of one case, whose only model is `model`."""
    of = lambda table, column: table[f"{model}_{column}"]
    errors = [of(result, f"one_step_{c}") for c in ("rms", "median", "p99")]
    training = time["training_wall_s"] if model == "pinc" else ""
    return [
        case,
        *map(error, errors),
        error(of(result, "jacobian_rms")),
        f"{float(of(time, 'forward_ns')):.0f}",
        f"{float(of(time, 'forward_jacobian_ns')):.0f}",
        f"{float(of(result, 'iae_dense_sum')):.6g}",
        f"{float(of(time, 'step_us')):.1f}",
        f"{float(training):.1f}" if training else "",
    ]


def read(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def main():
    directory = Path(sys.argv[1])
    print("| " + " | ".join(HEADS) + " |")
    print("|" + "---|" * len(HEADS))
    for result, time in zip(read(directory / "sweep.csv"), read(directory / "timings.csv")):
        for model in ("pinc", "rk4", "rk5", "rosenbrock"):
            if time.get(f"{model}_forward_ns"):
                print("| " + " | ".join(row(result["case"], result, time, model)) + " |")


if __name__ == "__main__":
    main()
