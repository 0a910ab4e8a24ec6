"""Trainings by the program, for the scripts beside this file. Python's standard library only."""

import csv
import json
import pathlib
import subprocess


def seeds(text):
    """The seeds of `3` or `0-4`."""
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def train(pinc, config, settings, out):
    """Trains into the folder `out`, with `settings` as `--set`; the rows of its `training.csv` and its `metrics.json`."""
    command = [pinc, "train", config, "--out", str(out), "--quiet"]
    for key, value in settings.items():
        command += ["--set", f"{key}={value}"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    with open(pathlib.Path(out) / "training.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    return rows, json.loads((pathlib.Path(out) / "metrics.json").read_text())


def validations(rows):
    """(row, validation error) where there was a validation."""
    return [(row, float(row["validation_mse"])) for row in rows if row["validation_mse"]]
