"""Measurements of a Van der Pol oscillator (mu = 1) for a net whose equation has a wrong mu, and how many it takes.

    python3 benches/data/van_der_pol.py files     writes the files that configs/van-der-pol/data.toml names
    python3 benches/data/van_der_pol.py table     trains with more and more of them, prints the table; beside it nets of
                                                  the equation with the mu that `pinc identify` finds in as many steps
"""

import argparse
import json
import pathlib
import random
import statistics
import subprocess
import tempfile

CONFIG = pathlib.Path("configs/van-der-pol/data.toml")
RECORD = pathlib.Path("configs/identification/oscillator.toml")
T = 0.5
NOISE = 0.01


def flow(x, u, t, mu=1.0, steps=2000):
    """RK4 with steps so small that its error, about 1e-13, is far below the noise."""

    def f(x):
        return (x[1], mu * (1 - x[0] ** 2) * x[1] - x[0] + u)

    h = t / steps
    for _ in range(steps):
        k1 = f(x)
        k2 = f([a + h / 2 * k for a, k in zip(x, k1)])
        k3 = f([a + h / 2 * k for a, k in zip(x, k2)])
        k4 = f([a + h * k for a, k in zip(x, k3)])
        x = [a + h / 6 * (p + 2 * q + 2 * r + s) for a, p, q, r, s in zip(x, k1, k2, k3, k4)]
    return x


def write(path, count, seed, noise):
    """Single steps from random states of [-3, 3]^2; of every other one only the position is measured."""
    draw = random.Random(seed)
    with open(path, "w") as file:
        file.write("t,u,x1_0,x2_0,x1,x2\n")
        for i in range(count):
            t = T * (1 + i % 4) / 4
            u = round(draw.uniform(-1, 1), 4)
            x0 = [round(draw.uniform(-3, 3), 4) for _ in range(2)]
            x1, x2 = (v + draw.gauss(0, noise) for v in flow(x0, u, t))
            velocity = f"{x2:.6f}" if noise == 0 or i % 2 == 0 else ""
            file.write(f"{t},{u},{x0[0]},{x0[1]},{x1:.6f},{velocity}\n")


def write_record(path, count, seed):
    """A record of steps one after the other; of every other row only the position is measured."""
    draw, x = random.Random(seed), [1.0, 0.0]
    with open(path, "w") as file:
        file.write("t,u,y_x1,y_x2\n")
        for i in range(count + 1):
            u = round(draw.uniform(-1, 1), 4)
            y1, y2 = (v + draw.gauss(0, NOISE) for v in x)
            file.write(f"{T * i},{u},{y1:.6f},{f'{y2:.6f}' if i % 2 == 0 else ''}\n")
            x = flow(x, u, T)


def files():
    write_record(RECORD.with_suffix(".csv"), 256, 256)
    write(CONFIG.parent / "measured-64.csv", 64, 64, NOISE)
    write(CONFIG.parent / "held-out.csv", 256, 1, 0.0)


def train(pinc, folder, count, seed, weight):
    """The root of the mean squared error on the held-out file, in standard deviations of the box."""
    out = folder / f"{count}-{seed}-{weight}"
    command = [pinc, "train", str(CONFIG), "--quiet", "--out", str(out), "--set", f"seed={seed}"]
    data = folder / f"{count}-{seed}-{weight}.csv"
    if weight is None:
        # Physics alone: a weight that counts for nothing, and the same held-out file.
        command += ["--set", "data.weight=1e-12"]
        if count:
            command += ["--set", f"plant.van-der-pol.mu={identified(pinc, data, count, seed)}"]
    else:
        write(data, count, 1000 * seed + count, NOISE)
        command += ["--set", f"data.files=['{data}']", "--set", f"data.weight={weight}"]
    subprocess.run(command, check=True)
    metrics = json.loads((out / "metrics.json").read_text())
    return metrics["validation"]["measured_mse"] ** 0.5


def identified(pinc, data, count, seed):
    """The mu found in a record."""
    write_record(data, count, 1000 * seed + count)
    out = data.with_suffix("")
    out = out.with_name(f"{out.name}-found")
    command = [pinc, "identify", str(RECORD), "--quiet", "--data", str(data), "--out", str(out)]
    subprocess.run(command, check=True)
    return json.loads((out / "identify.json").read_text())["parameters"]["mu"]["value"]


def table(pinc, counts, seeds, weights):
    print("| measured steps | " + " | ".join([f"weight {w}" for w in weights] + ["mu identified"]) + " |")
    print("|---" * (2 + len(weights)) + "|")
    with tempfile.TemporaryDirectory() as folder:
        for count in counts:
            cells = []
            for weight in [*weights, None] if count else [None]:
                errors = [train(pinc, pathlib.Path(folder), count, s, weight) for s in seeds]
                spread = f"{min(errors):.1e} to {max(errors):.1e}"
                cells.append(f"{statistics.median(errors):.1e} ({spread})")
            print(f"| {count or 'none'} | " + " | ".join(cells + [""] * (len(weights) + 1 - len(cells))) + " |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=["files", "table"])
    parser.add_argument("--pinc", default="target/release/pinc")
    parser.add_argument("--counts", default="0,4,16,64,256")
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--weights", default="1,10,100")
    given = parser.parse_args()
    if given.what == "files":
        files()
    else:
        numbers = [[int(n) for n in text.split(",")] for text in (given.counts, given.seeds, given.weights)]
        table(given.pinc, *numbers)
