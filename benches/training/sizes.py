#!/usr/bin/env python3
"""Full against limited memory by the size of the net: which optimizer is further after a time.

    cargo build --release
    python3 benches/training/sizes.py --sizes 4x20,4x32,4x40,4x50,4x64 --time 9

Trains the Van der Pol config with nets of each size for the same time (`elapsed_s` of `training.csv`, validation apart), once with self-scaled Broyden and once
with L-BFGS with the settings of preset `ours`, and prints a Markdown table. Nothing else should run on the machine.
"""

import argparse
import pathlib
import tempfile

from runs import train, validations

OPTIMIZERS = {
    "self-scaled Broyden": "{ self-scaled-broyden = { initial_step = 0.1 } }",
    "L-BFGS": '{ lbfgs = { memory = 20, line_search = "weak-wolfe" } }',
}


def weights(layers, neurons):
    """Weights and biases of the net: inputs t, x1, x2, u, two outputs."""
    return 5 * neurons + (layers - 1) * (neurons + 1) * neurons + 2 * (neurons + 1)


def run(args, size, optimizer):
    """Iterations in the time, ms of one, and the best validation error."""
    layers, neurons = size
    settings = {
        "model.hidden_layers": layers,
        "model.neurons": neurons,
        "training.phases": f"[{{ optimizer = {optimizer}, iterations = 1_000_000 }}]",
        "training.time_limit_s": args.time,
        "training.validation_every": 10,
        "training.checkpoint_every_s": 1e6,
        "seed": args.seed,
    }
    with tempfile.TemporaryDirectory() as folder:
        rows, _ = train(args.pinc, "configs/van-der-pol/main.toml", settings, pathlib.Path(folder) / "run")
    iterations = int(rows[-1]["iteration"])
    return iterations, 1e3 * float(rows[-1]["elapsed_s"]) / iterations, min(error for _, error in validations(rows))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pinc", default="target/release/pinc", help="the program")
    parser.add_argument("--sizes", default="4x20,4x32,4x40,4x50,4x64", help="layers x neurons")
    parser.add_argument("--time", type=float, default=9.0, help="in s")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()

    head = ["net", "weights"] + [f"{name}: {what}" for name in OPTIMIZERS for what in ("iterations", "ms each", f"mse_gen after {args.time:g} s")]
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head), flush=True)
    for text in args.sizes.split(","):
        size = tuple(int(part) for part in text.split("x"))
        cells = [text, f"{weights(*size)}"]
        for optimizer in OPTIMIZERS.values():
            iterations, each, error = run(args, size, optimizer)
            cells += [f"{iterations}", f"{each:.1f}", f"{error:.1e}"]
        print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
