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
import pathlib
import sys

CONFIG = pathlib.Path(__file__).resolve().parent / "duffing.toml"
sys.path.insert(0, str(CONFIG.parents[1]))

from records import agreement, going_on, identified, write  # noqa: E402

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
    files = {
        name: write(record[first:end], CONFIG, given.out / f"{name}.csv")
        for name, (first, end) in PARTS.items()
    }
    short = identified(given.pinc, CONFIG, [files.pop("short")], given.out / "short")
    print(agreement(short))
    sets = going_on(CONFIG, short)
    found = identified(given.pinc, CONFIG, list(files.values()), given.out / "whole", sets)
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
