#!/usr/bin/env python3
"""How training, memory, `check` and the control step grow with the parts of the heated rod.

    cargo build --release
    python3 benches/distributed/growth.py --parts 20,50,100

For each number of parts: `pinc check`, whole process; a training of some iterations of a net with three layers of `--neurons`, in ms per evaluation of loss and
gradient and in peak memory; and the median control step with RK4 with as few substeps as are stable, and with the linearly implicit method with one. Prints a
Markdown table. Nothing else should run on the machine.
"""

import argparse
import json
import os
import pathlib
import subprocess
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
CONFIG = ROOT / "configs" / "distributed" / "rod.toml"

# The fastest mode of the rod in 1/s is 4 a n^2/length^2; RK4 is stable up to 2.78 per substep.
DIFFUSIVITY = 50.0 / (7800.0 * 480.0)


def stable_substeps(parts):
    fastest = 4.0 * DIFFUSIVITY * (parts / 0.2) ** 2
    return max(2, int(5.0 * fastest / 2.78) + 1)


def pinc(args, command, sets, out=None, only=None):
    """Wall time in s and peak memory in MB of a command."""
    line = [str(args.pinc), command, str(CONFIG)]
    for key, value in sets.items():
        line += ["--set", f"{key}={value}"]
    if only is not None:
        line += ["--only", only]
    if out is not None:
        line += ["--quiet", "--out", str(out)]
    start = time.monotonic()
    process = subprocess.Popen(line, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        raise SystemExit(f"{' '.join(line)} failed")
    return time.monotonic() - start, usage.ru_maxrss / 1024.0


def row(args, parts):
    substeps = stable_substeps(parts)
    size = {"plant.expression.sizes.n": parts}
    check_s, _ = pinc(args, "check", size | {"control.rk4_substeps": substeps})
    training = {
        "model.neurons": args.neurons,
        "training.phases": f'[{{ optimizer = {{ lbfgs = {{ memory = 20, line_search = "weak-wolfe" }} }}, iterations = {args.iterations} }}]',
        "training.growth.max_points": 1024,
        "validation.scenarios": 2,
        "validation.one_step_points": 256,
    }
    # Up to the first step after the change of the reference: the median needs no more.
    loop = {
        "control.duration_s": 305.0,
        "control.models": '["rk4", "rosenbrock"]',
        "control.rk4_substeps": substeps,
        "control.rosenbrock_substeps": 1,
        "control.plant_tolerance": 1e-8,
        "control.repetitions": 1,
    }
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        _, memory = pinc(args, "train", size | training, folder / "train")
        trained = json.loads((folder / "train" / "metrics.json").read_text())["training"]
        evaluation_ms = 1e3 * trained["optimizer_s"] / trained["loss_evaluations"]
        steps = []
        for model in ["rk4", "rosenbrock"]:
            pinc(args, "control", size | loop, folder / model, model)
            [measured] = json.loads((folder / model / "metrics.json").read_text())["control"]
            steps.append(measured["step_us"]["p50"])
    return [parts, f"{check_s:.1f}", f"{evaluation_ms:.1f}", f"{memory:.0f}", substeps] + [f"{us:.0f}" for us in steps]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pinc", type=pathlib.Path, default=ROOT / "target" / "release" / "pinc")
    parser.add_argument("--parts", default="20,50,100")
    parser.add_argument("--neurons", type=int, default=64)
    parser.add_argument("--iterations", type=int, default=100)
    args = parser.parse_args()
    print("| parts | check, s | loss and gradient, ms | memory of the training, MB | substeps | RK4, us a step | Rosenbrock x1, us |")
    print("|---|---|---|---|---|---|---|")
    for parts in map(int, args.parts.split(",")):
        print("| " + " | ".join(str(cell) for cell in row(args, parts)) + " |", flush=True)


if __name__ == "__main__":
    main()
