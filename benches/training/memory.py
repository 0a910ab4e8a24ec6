#!/usr/bin/env python3
"""Peak resident memory of a training with the paper's recipe, by points, width, depth and threads (Linux, macOS).

    cargo build --release
    python3 benches/training/memory.py

Each training does a few iterations of Adam and of L-BFGS, enough to fill all memory. Prints a Markdown table.
"""

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile

BASE = {
    "preset": "as-printed",
    "training.phases.0.iterations": 2,
    "training.phases.1.iterations": 12,
    "training.threads": 2,
}

CASES = [
    ("10 000 points", {"training.collocation_points": 10_000}),
    ("100 000 points (the paper's)", {}),
    ("400 000 points", {"training.collocation_points": 400_000}),
    ("1 thread", {"training.threads": 1}),
    ("4 threads", {"training.threads": 4}),
    ("8 threads", {"training.threads": 8}),
    ("4 layers of 40", {"model.neurons": 40}),
    ("4 layers of 64", {"model.neurons": 64}),
    ("10 layers of 64", {"model.neurons": 64, "model.hidden_layers": 10}),
]


def peak_mb(pinc, settings):
    """Peak resident memory in MB."""
    with tempfile.TemporaryDirectory() as folder:
        out = str(pathlib.Path(folder) / "run")
        command = [pinc, "train", "configs/van-der-pol/main.toml", "--quiet", "--out", out]
        for key, value in settings.items():
            command += ["--set", f"{key}={value}"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        sys.exit(f"{' '.join(command)} failed")
    unit = 1 if sys.platform == "darwin" else 1024
    return usage.ru_maxrss * unit / 1e6


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pinc", default="target/release/pinc", help="the program")
    args = parser.parse_args()
    print("| Van der Pol 4x20, 100 000 points, 2 threads, but for | peak MB |\n|---|---|", flush=True)
    for name, settings in CASES:
        print(f"| {name} | {peak_mb(args.pinc, BASE | settings):.0f} |", flush=True)


if __name__ == "__main__":
    main()
