"""Loss and gradient of pinc and of its peers in JAX, in turns, and how many times faster pinc is.

    cargo build --release
    python benches/peers/compare.py [--pinc target/release/pinc] [--rounds 7]

In each round each program computes for a second or so while the others rest. All of them compute the
same numbers, which is checked first.
"""

import argparse
import json
import statistics
import subprocess
import tempfile
from pathlib import Path

import evaluation as ev
import jax_loss_gradient as peers

TOP = Path(__file__).resolve().parents[2]


def pinc(program, file):
    """The time of pinc on all threads in ms and its part of the machine's peak; writes `file`."""
    command = [program, "bench", "--json", "--loss-gradient-file", file]
    output = subprocess.run(command, check=True, stdout=subprocess.PIPE,
                            stderr=subprocess.DEVNULL).stdout
    best = max(json.loads(output)["loss_gradient"], key=lambda row: row["threads"])
    return best["ms"], best["fraction_of_peak"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pinc", default=str(TOP / "target/release/pinc"))
    parser.add_argument("--rounds", type=int, default=7)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "evaluation.safetensors")
        pinc(arguments.pinc, file)
        evaluation = ev.read(file)
        problem = peers.Problem(evaluation)
        works = {name: build(problem) for name, build in peers.VARIANTS.items()}
        for name, work in works.items():
            error = ev.check(evaluation, name, *work())
            print(f"{name}: the same loss and gradient to {error:.0e}")
        ours, peak, theirs = [], [], {name: [] for name in works}
        for _ in range(arguments.rounds):
            ms, fraction = pinc(arguments.pinc, file)
            ours.append(ms)
            peak.append(fraction)
            for name, work in works.items():
                theirs[name].append(peers.timed(work, 1.0))
    mine = statistics.median(ours)
    print(f"\nmedians of {arguments.rounds} rounds")
    print(f"pinc     {mine:8.1f} ms   {100 * statistics.median(peak):.0f} % of the peak")
    for name, times in theirs.items():
        ratios = [other / own for own, other in zip(ours, times)]
        print(f"{name:8} {statistics.median(times):8.1f} ms   "
              f"pinc is {statistics.median(ratios):.2f} times as fast "
              f"({min(ratios):.2f} to {max(ratios):.2f})")


if __name__ == "__main__":
    main()
