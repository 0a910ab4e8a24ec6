"""Closed loops with nets and with integrators side by side, from sweeps with [one_step]:

    for plant in rod rod-20s reactor gas-lift pump; do pinc run configs/pareto/$plant.toml; done
    python3 benches/pareto/loops.py --rounds 5 runs/{rod,rod-20s,reactor,gas-lift,pump}-pareto

Of each plant: all nets, of each numerical method the one with the shortest control step among those
whose IAE is within 1 % of the exact model's, and the exact model, which is the one of least error.
With `--rounds` the loops of these rows are run again, in turns, with the nets of the sweep; the least
and the median of the rounds' median control steps are printed. Without it, the sweep's median control
step is printed.
Needs Python 3.11 alone, and `pinc` in the path or by `--pinc`.
"""

import argparse
import json
import math
import subprocess
import tempfile
import tomllib
from pathlib import Path
from statistics import median

from sweep import MODELS, exact, is_good, loops, methods, off

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


def shown(found):
    """The loops of the table, with the exact model's last."""
    standard = exact(found)
    chosen = [loop for loop in found if loop["model"] == "pinc"]
    for model in MODELS:
        own = [m for m in methods(found) if m["model"] == model and is_good(m, standard)]
        chosen += sorted(own, key=lambda loop: loop["step"])[:1]
    return [loop for loop in chosen if loop is not standard] + [standard]


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


def control(pinc, arguments):
    """The median control step of one more run of a loop, in us."""
    with tempfile.TemporaryDirectory() as folder:
        line = [pinc, "control", *arguments, "--quiet", "--out", f"{folder}/run"]
        subprocess.run([str(part) for part in line], check=True)
        metrics = json.loads((Path(folder) / "run" / "metrics.json").read_text())
    return metrics["control"][0]["step_us"]["p50"]


def again(pinc, directory, loop, more=()):
    """Runs a loop of the sweep in `directory` again, with `more` arguments."""
    config = Path("configs/pareto") / (directory.name.removesuffix("-pareto") + ".toml")
    cases = tomllib.loads(config.read_text())["sweep"]["cases"]
    case = next(case for case in cases if case["name"] == loop["case"])
    line = [config, "--only", loop["model"], *more]
    # The error of a step is known from the sweep.
    for key, value in (case["set"] | {"one_step.points": 16, "one_step.measure_s": 0.01}).items():
        line += ["--set", f"{key}={json.dumps(value)}"]
    if loop["model"] == "pinc":
        line += ["--model", net(directory, case)]
    return control(pinc, line)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--rounds", type=int, default=0)
    parser.add_argument("--pinc", default="pinc")
    args = parser.parse_args()
    print("| " + " | ".join(HEADS) + " |")
    print("|" + "---|" * len(HEADS))
    for directory in args.runs:
        chosen = shown(list(loops(directory)))
        for _ in range(args.rounds):
            for loop in chosen:
                loop.setdefault("rounds", []).append(again(args.pinc, directory, loop))
        for loop in chosen:
            steps = loop.get("rounds", [loop["step"]])
            training = loop["training"]
            cells = [
                directory.name.removesuffix("-pareto") if loop is chosen[0] else "",
                loop["case"],
                f"{loop['rms']:.1e}",
                f"{loop['iae']:.6g}",
                f"{100.0 * off(loop, chosen[-1]):+.2f} %",
                f"{loop['offset']:.1e}",
                f"{loop['iterations']:.1f}",
                f"{min(steps):.1f}",
                f"{median(steps):.1f}",
                "" if math.isnan(training) else f"{training:.0f}",
            ]
            print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
