"""Identifies the Silverbox from the record in SNLS80mV.csv and simulates the test parts.

usage: python run.py SNLS80mV.csv [--pinc target/release/pinc] [--out DIR]

The record is of T. Wigren and J. Schoukens, "Three free data sets for development and benchmarking in
nonlinear system identification" (2013). Columns: V1, V2; 610.35 Hz.

The rules of this script, which were fixed before any test part was simulated or looked at:

1. Parts are those of the package nonlinear_benchmarks: rows 40650 to 127400 are multisines, of which
   the first three quarters are for training and the rest is a test; rows 100 to 40575 are the arrow,
   a test whose amplitude grows beyond the training data, and its first 32000 rows are a third test.
   The first 50 rows of a test give its initial state and do not count.
2. Recording is band-limited, and a model holds its input. So the input is interpolated to four times
   the rate by a Lanczos kernel of 32 rows, at the middle of each quarter; three of four rows have no
   measurement.
3. The model is duffing.toml. It was chosen within the training part, by the error on its last 17062
   rows after fits to the first 48000: with a spring of y, y^2 and y^3 and damping by v 0.297 mV; with
   damping by v y^2 as well 0.2467 mV, or by v^3 as well 0.2444 mV. y^5, v y, u y or a feedthrough
   beside v y^2 gained less than 1 %, so there is nothing else in it.
4. `pinc identify` fits it to the first 8000 rows of the training part by simulation error from 16
   starts, seed 1, and from there to the whole part. There is no net and no weight to be chosen.
5. All tests are simulated once, and the figures published whatever they are.
"""

import argparse
import csv
import json
import math
import pathlib
import subprocess
import tomllib

CONFIG = pathlib.Path(__file__).resolve().parent / "duffing.toml"
STEP = tomllib.loads(CONFIG.read_text())["identify"]["step_s"]
QUARTERS, REACH = 4, 16
TRAINING = 40650 + (127400 - 40650) * 3 // 4
PARTS = {
    "training": (40650, TRAINING),
    "multisine": (TRAINING, 127400),
    "arrow": (100, 40575),
    "arrow-inner": (100, 32100),
    "short": (40650, 48650),
}
# Test errors on the arrow in mV as A. Van Mulders' thesis compares them.
PUBLISHED = [
    ("best linear approximation", 5, "13.7"),
    ("local linear state space (Verdult 2004)", 16, "1.3"),
    ("nonlinear feedback (Hjalmarsson, Schoukens 2004)", 5, "0.96"),
    ("nonlinear feedback (Paduart 2004)", 10, "0.38"),
    ("polynomial feedback (Van Mulders 2011)", 11, "0.35"),
    ("state space with sigmoids (Marconato 2012)", 23, "0.34"),
    ("support vectors (Espinoza 2004)", 490, "0.32"),
    ("nonlinear ARX (Ljung 2004)", 712, "0.30"),
    ("polynomial state space (Paduart 2008)", 37, "0.26"),
]


def lanczos(x):
    """The kernel of interpolation."""
    if x == 0:
        return 1.0
    turn = math.pi * x
    return REACH * math.sin(turn) * math.sin(turn / REACH) / turn**2


def weights(quarter):
    """The weights of the rows around the middle of a quarter of a row's interval."""
    at = (quarter + 0.5) / QUARTERS
    of = [lanczos(at - j) for j in range(1 - REACH, REACH + 1)]
    return [weight / sum(of) for weight in of]


def part(record, name, out):
    """Writes a part of the record as a file of `pinc identify`."""
    first, end = PARTS[name]
    rows, by_quarter = record[first:end], [weights(quarter) for quarter in range(QUARTERS)]
    file = out / f"{name}.csv"
    with open(file, "w") as to:
        to.write("t,u,y_out\n")
        for k, (_, y) in enumerate(rows):
            near = range(k + 1 - REACH, k + REACH + 1)
            u = [rows[min(max(at, 0), len(rows) - 1)][0] for at in near]
            for quarter, of in enumerate(by_quarter):
                held = sum(weight * value for weight, value in zip(of, u))
                time = (k * QUARTERS + quarter) * STEP
                to.write(f"{time!r},{held:.7f},{y if quarter == 0 else ''}\n")
    return file


def identified(pinc, files, out, sets=()):
    """Runs `pinc identify` and returns identify.json."""
    command = [pinc, "--quiet", "identify", CONFIG, "--data", files[0], "--out", out]
    command += [word for file in files[1:] for word in ("--validate", file)]
    command += [word for set in sets for word in ("--set", set)]
    subprocess.run([str(word) for word in command], check=True)
    return json.loads((out / "identify.json").read_text())


def going_on(found):
    """Settings for a fit from where another ended."""
    spec = tomllib.loads(CONFIG.read_text())["identify"]["parameters"]
    point = [{**of, "initial": found["parameters"][of["name"]]["value"]} for of in spec]
    rows = ["{ " + ", ".join(f"{k} = {json.dumps(v)}" for k, v in of.items()) + " }" for of in point]
    return ["identify.starts=1", f"identify.parameters=[{', '.join(rows)}]"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("record", type=pathlib.Path)
    parser.add_argument("--pinc", default="target/release/pinc")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("runs/silverbox"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    with open(given.record, newline="") as file:
        record = [row[:2] for row in csv.reader(file) if len(row) > 1 and row[0] != "V1"]
    record = [(float(u), float(y)) for u, y in record if u]
    short = identified(given.pinc, [part(record, "short", given.out)], given.out / "short")
    finished = [start for start in short["starts"] if start["status"] != "set aside"]
    near = sum(start["cost"] <= 1.01 * short["cost"] for start in finished)
    print(f"{near} of {len(finished)} finished starts end within 1 % of the best cost")
    names = ["training", "multisine", "arrow", "arrow-inner"]
    files = [part(record, name, given.out) for name in names]
    found = identified(given.pinc, files, given.out / "whole", going_on(short))
    rms = [found["residuals"]["out"]["rms"], *(of["rms"]["out"] for of in found["held_out"])]
    head = ["model", "parameters", "training", "multisine", "arrow", "arrow, first 32000 rows"]
    row = ["physics", len(found["parameters"]), *(f"{1000 * of:.3f}" for of in rms)]
    rows = [[*head, "source"], [*row, "this project"]]
    rows += [[name, count, "", "", error, "", "published"] for name, count, error in PUBLISHED]
    with open(given.out / "silverbox.csv", "w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)
    print((given.out / "silverbox.csv").read_text(), end="")


if __name__ == "__main__":
    main()
