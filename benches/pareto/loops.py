"""Closed loops with nets and with integrators side by side, from sweeps with [one_step]:

    for plant in rod rod-20s reactor gas-lift pump; do pinc run configs/pareto/$plant.toml; done
    python3 benches/pareto/loops.py --rounds 5 runs/{rod,rod-20s,reactor,gas-lift,pump}-pareto

Of each plant: all nets, of each numerical method the one with the shortest control step among those
whose IAE is within 1 % of the exact model's, and the exact model, which is the one of least error.
With `--rounds` the loops of these rows are run again, in turns, with the nets of the sweep, and the
least and the middle one of the rounds' median control steps are printed; without, that of the
sweep.
Needs Python 3.11 alone, and `pinc` in the path or by `--pinc`.
"""

import argparse
import json
import subprocess
import tempfile
import tomllib
from pathlib import Path
from statistics import median

from table import cases, number

METHODS = ("rk4", "rk5", "rosenbrock")
HEADS = (
    "plant",
    "model",
    "one step, rms",
    "IAE",
    "against the exact model's",
    "offset at rest",
    "SQP iterations",
    "control step, us: least",
    "median",
    "training, s",
)


def rows(directory):
    """What the sweep found of its cases whose loops did not fail."""
    return [
        {
            "case": result["case"],
            "model": model,
            "rms": number(result[f"{model}_one_step_rms"]),
            "iae": number(result[f"{model}_iae_dense_sum"]),
            "offset": number(result[f"{model}_offset_max"]),
            "iterations": number(result[f"{model}_sqp_iterations_mean"]),
            "steps": [number(time[f"{model}_step_us"])],
            "training": number(time["training_wall_s"]) if model == "pinc" else None,
        }
        for result, time, model in cases(directory, "step_us")
        if result["status"] == "done"
    ]


def shown(found):
    """The rows of the table, with the exact model's last."""
    methods = [row for row in found if row["model"] != "pinc"]
    exact = min((row for row in methods if row["rms"] == row["rms"]), key=lambda row: row["rms"])
    good = lambda row: abs(row["iae"] / exact["iae"] - 1.0) < 0.01
    chosen = [row for row in found if row["model"] == "pinc"]
    for method in METHODS:
        own = [row for row in methods if row["model"] == method and good(row)]
        chosen += sorted(own, key=lambda row: row["steps"][0])[:1]
    return [row for row in chosen if row is not exact] + [exact]


def net(directory, case):
    """The file of the net that a case has."""
    wanted = {"training.source": "physics"} | case["set"]
    for folder in sorted((directory / "nets").iterdir()):
        config = tomllib.loads((folder / "config.toml").read_text())
        config["training"].setdefault("source", "physics")
        keys = ("model.hidden_layers", "model.neurons", "training.source")
        parts = [key.split(".") for key in keys]
        if all(config[a][b] == wanted[key] for key, (a, b) in zip(keys, parts)):
            return folder / "model.safetensors"
    raise SystemExit(f"{directory}: no net of {case['name']}")


def again(args, directory, row):
    """The median control step of one more run of a row's loop, in us."""
    config = Path("configs/pareto") / (directory.name.removesuffix("-pareto") + ".toml")
    cases = tomllib.loads(config.read_text())["sweep"]["cases"]
    case = next(case for case in cases if case["name"] == row["case"])
    line = [args.pinc, "control", config, "--only", row["model"], "--quiet"]
    # The error of a step is known from the sweep.
    for key, value in (case["set"] | {"one_step.points": 16, "one_step.measure_s": 0.01}).items():
        line += ["--set", f"{key}={json.dumps(value)}"]
    if row["model"] == "pinc":
        line += ["--model", net(directory, case)]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([*map(str, line), "--out", f"{folder}/run"], check=True)
        metrics = json.loads((Path(folder) / "run" / "metrics.json").read_text())
    return metrics["control"][0]["step_us"]["p50"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--rounds", type=int, default=0)
    parser.add_argument("--pinc", default="pinc")
    args = parser.parse_args()
    print("| " + " | ".join(HEADS) + " |")
    print("|" + "---|" * len(HEADS))
    for directory in args.runs:
        chosen = shown(rows(directory))
        for _ in range(args.rounds):
            for row in chosen:
                row.setdefault("rounds", []).append(again(args, directory, row))
        for row in chosen:
            steps = row.get("rounds", row["steps"])
            training = f"{row['training']:.0f}" if row["training"] is not None else ""
            cells = [
                directory.name.removesuffix("-pareto") if row is chosen[0] else "",
                row["case"],
                f"{row['rms']:.1e}",
                f"{row['iae']:.6g}",
                f"{100.0 * (row['iae'] / chosen[-1]['iae'] - 1.0):+.2f} %",
                f"{row['offset']:.1e}",
                f"{row['iterations']:.1f}",
                f"{min(steps):.1f}",
                f"{median(steps):.1f}",
                training,
            ]
            print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
