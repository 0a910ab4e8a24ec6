"""Control steps of acados and of pinc, in turns, from the same states of the same closed loops.

    cargo build --release
    python benches/peers/acados/compare.py --acados DIR [--rounds 12] [--cases NAME ..] [--all]

DIR is a checkout of acados with the submodules blasfeo, hpipm and daqp; it is built into --build,
once. In each round pinc runs a loop, and then each setting of acados gets the states of that loop
one by one, solves the same problem from its plan of the step before, and is timed. Of each QP
solver the setting with the least mean counts. Settings that fail in a step, or whose inputs
differ from pinc's by more than --tolerance in any, are out.
"""

import argparse
import csv
import json
import os
import statistics
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from safetensors import safe_open

HERE = Path(__file__).resolve().parent
TOP = HERE.parents[2]
COMPILER = ["gcc", "-std=gnu11", "-Ofast", "-march=native", "-DACADOS_WITH_DAQP"]
ROD = TOP / "configs/distributed/rod.toml"


@dataclass
class Case:
    """A loop: a config, its plant in C, the model (rk4, or pinc: a net), overrides of [control],
    and whether acados gets the net as pinc exports it."""
    config: str
    plant: str
    model: str = "rk4"
    horizon: int | None = None
    more: dict = field(default_factory=dict)
    exported: bool = False

    def overrides(self):
        values = dict(self.more)
        if self.horizon:
            values |= {"n2": self.horizon, "nu": self.horizon}
        return [f"control.{key}={value}" for key, value in values.items()]

    def repetitions(self, wanted):
        """Runs of the loop in a round: fewer of the long horizons."""
        return max(1, wanted // 5) if self.horizon else wanted


OSCILLATOR = ("van-der-pol/control.toml", "van_der_pol")
TANKS = ("four-tanks/control.toml", "four_tanks")
CASES = {
    "oscillator-rk4": Case(*OSCILLATOR),
    "oscillator-net": Case(*OSCILLATOR, "pinc"),
    "tanks-rk4": Case(*TANKS),
    "tanks-net": Case(*TANKS, "pinc"),
    "oscillator-net-exported": Case(*OSCILLATOR, "pinc", exported=True),
    "tanks-net-exported": Case(*TANKS, "pinc", exported=True),
    "oscillator-rk4-80": Case(*OSCILLATOR, horizon=80),
    "oscillator-rk4-160": Case(*OSCILLATOR, horizon=160),
    "tanks-rk4-40": Case(*TANKS, horizon=40),
    "tanks-rk4-80": Case(*TANKS, horizon=80),
    "rod-rk4-20": Case("distributed/rod.toml", "rod", more={"state_softness": '"hard"'}),
}


def settings(horizon):
    """Of acados, in the order of the driver's arguments."""
    found = [("daqp", 0, "-", 1e-9, 1, first, shift) for shift in (0, 1) for first in (0, 1)]
    for qp, stages in [("hpipm-full", [0]), ("hpipm-partial", partial(horizon))]:
        for cond_n in stages:
            for mode, tolerance in (("SPEED", 1e-9), ("SPEED", 1e-11), ("BALANCE", 1e-11)):
                for warm, first in ((0, 0), (1, 2)):
                    found.append((qp, cond_n, mode, tolerance, warm, first, 1))
    return found


def partial(horizon):
    """Numbers of stages that partial condensing leaves."""
    blocks = (1, 2, 5) if horizon <= 10 else (1, 2, 4, 8, 16)
    return sorted({-(-horizon // block) for block in blocks})


def run(command, **options):
    command = [str(part) for part in command]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, **options)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)}: exit {done.returncode}")
    return done.stdout


def build(source, folder, target):
    """Builds and installs acados, and gives the folder that it is installed in."""
    installed = folder / "install"
    if not (installed / "lib/libacados.a").exists():
        print(f"building acados in {folder}", file=sys.stderr)
        run(["cmake", "-S", source, "-B", folder, "-DCMAKE_BUILD_TYPE=Release",
             "-DCMAKE_C_FLAGS=-O3 -march=native", "-DACADOS_WITH_DAQP=ON", "-DACADOS_SILENT=ON",
             f"-DBLASFEO_TARGET={target}", "-DHPIPM_TARGET=AVX", "-DBUILD_SHARED_LIBS=OFF",
             f"-DCMAKE_INSTALL_PREFIX={installed}"])
        run(["cmake", "--build", folder, "--target", "install", "--parallel", os.cpu_count()])
    return installed


def table(name, values):
    """A constant of C. repr of a float is exact."""
    values = np.asarray(values, dtype=float)
    size = "".join(f"[{n}]" for n in values.shape)
    numbers = ", ".join(repr(float(value)) for value in values.ravel())
    return f"static const double {name}{size} = {{{numbers}}};\n"


def write_net(model, path):
    """The weights of a model file for net.c."""
    with safe_open(model, framework="numpy") as file:
        meta = json.loads(file.metadata()["model"])
        tensors = {name: file.get_tensor(name).astype(float) for name in file.keys()}
    depth = len(tensors) // 2 - 1
    weights = [tensors[f"layers.{i}.weight"] for i in range(depth + 1)]
    biases = [tensors[f"layers.{i}.bias"] for i in range(depth + 1)]
    mean, std = np.array(meta["input_mean"]), np.array(meta["input_std"])
    out_mean, out_std = np.array(meta["output_mean"]), np.array(meta["output_std"])
    first = weights[0] / std
    bias_in = biases[0] - first @ mean + first[:, 0] * meta["horizon_s"]
    last, bias_out = out_std[:, None] * weights[-1], out_mean + out_std * biases[-1]
    neurons = len(bias_in)
    width = -(-neurons // 8) * 8
    wide, hard = width - neurons, int(meta["ansatz"] == "hard-linear")
    inner = np.array([np.pad(w, ((0, wide), (0, wide))) for w in weights[1:-1]])
    path.write_text(
        f"enum {{ DEPTH = {depth}, WIDTH = {width}, HARD = {hard} }};\n"
        + table("weight_in", np.pad(first[:, 1:].T, ((0, 0), (0, wide))))
        + table("bias_in", np.pad(bias_in, (0, wide)))
        + table("weight", inner)
        + table("weight_transposed", inner.transpose(0, 2, 1))
        + table("bias", np.array([np.pad(b, (0, wide)) for b in biases[1:-1]]))
        + table("weight_out", np.pad(last, ((0, 0), (0, wide))))
        + table("bias_out", bias_out))


def read(path):
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    return rows[0], rows[1:]


class Loop:
    """A case with pinc's program and acados' driver for it."""

    def __init__(self, case, arguments, installed, folder):
        self.case, self.arguments, self.folder = case, arguments, folder
        self.repetitions = case.repetitions(arguments.repetitions)
        folder.mkdir()
        self.config = TOP / "configs" / case.config
        self.flags = ["--only", case.model]
        if case.model == "pinc":
            self.flags += ["--model", self.train()]
        self.out, self.problem = folder / "pinc", folder / "problem.txt"
        metrics = self.pinc()
        used = tomllib.loads((self.out / "config.toml").read_text())
        self.horizon = used["control"]["n2"]
        *self.steps, controlled = self.read_steps(metrics)
        self.size = len(metrics["states"]), len(metrics["inputs"])
        self.write_problem(used["control"], {**metrics, "controlled": controlled})
        self.driver = folder / "driver"
        self.compile(used, installed)

    def train(self):
        """A net for the loop, kept with --models so that runs can be compared."""
        models = Path(self.arguments.models) if self.arguments.models else self.folder
        kept = models / f"{self.case.plant}.safetensors"
        if not kept.exists():
            out = self.folder / "training"
            run([self.arguments.pinc, "train", self.config, "--quiet", "--out", out, "--set",
                 f"training.time_limit_s={self.arguments.training_s:.1f}"])
            models.mkdir(exist_ok=True)
            (out / "model.safetensors").rename(kept)
        return kept

    def pinc(self):
        """Runs the loop and gives its metrics."""
        command = [self.arguments.pinc, "control", self.config, "--quiet", "--out", self.out]
        command += self.flags
        for override in [*self.case.overrides(), f"control.repetitions={self.repetitions}"]:
            command += ["--set", override]
        run(command)
        return json.loads((self.out / "metrics.json").read_text())

    def read_steps(self, metrics):
        """States, inputs and references at the steps of the loop, of which control.csv has ten rows
        each, ends shared, and the names of what follows the references."""
        header, rows = read(self.out / "control.csv")
        rows = np.array(rows, dtype=float)
        after = 1 + len(metrics["states"])
        states, inputs, references = np.split(rows[:, 1:], np.cumsum([
            len(metrics["states"]), len(metrics["inputs"])]), axis=1)
        names = [name.removesuffix("_ref") for name in header[after + len(metrics["inputs"]):]]
        return states[:-1:9], inputs[1::9], references[1::9], names

    def write_problem(self, control, names):
        states, inputs, references = self.steps
        n, m = self.size
        index = [names["states"].index(name) for name in names["controlled"]]
        lines = [[self.horizon, len(index), len(states)], index, control["q"], control["r"]]
        for key, size in (("state_low", n), ("state_high", n), ("input_low", m), ("input_high", m)):
            # One number stands for all elements of a vector.
            lines.append(np.broadcast_to(control[key], size))
        before = np.vstack([np.zeros((1, m)), inputs[:-1]])
        lines += np.hstack([states, before, references]).tolist()
        self.problem.write_text("\n".join(" ".join(f"{v:.17g}" for v in line) for line in lines))

    def compile(self, used, installed):
        case = self.case
        flags = [f"-DNX={self.size[0]}", f"-DNU={self.size[1]}", f"-I{HERE}", f"-I{self.folder}"]
        if case.exported:
            run([self.arguments.pinc, "export", "--model", self.flags[-1], "--to", "c", "--name",
                 "net", "--out", self.folder / "exported"])
            flags.append(f"-I{self.folder}/exported")
            model = HERE / "exported.c"
        elif case.model == "pinc":
            write_net(self.flags[-1], self.folder / "net_weights.h")
            model = HERE / "net.c"
        else:
            model = HERE / "rk4.c"
            substeps = used["control"]["rk4_substeps"]
            flags += [f'-DPLANT="{case.plant}.h"', f"-DSTEP_S={used['model']['horizon_s']}",
                      f"-DSUBSTEPS={substeps}"]
        libraries = ["-lacados", "-lhpipm", "-lblasfeo", "-ldaqpstat", "-lm"]
        include = installed / "include"
        run([*COMPILER, *flags, f"-I{include}", f"-I{include}/blasfeo/include",
             f"-I{include}/hpipm/include", f"-I{include}/daqp", model, HERE / "driver.c",
             f"-L{installed}/lib", *libraries, "-o", self.driver])

    def acados(self, setting, repetitions):
        """Times of a step, the largest difference of an input, steps that failed, QPs a step."""
        output = run([self.driver, self.problem, *setting, repetitions])
        rows = np.loadtxt(output.splitlines(), ndmin=2)
        wanted = self.steps[1][rows[:, 1].astype(int)]
        apart = np.abs(rows[:, 6:] - wanted).max()
        us = rows[:, 2].reshape(repetitions, -1)
        times = [np.median(us), np.median(us.mean(axis=1)), np.percentile(us, 99), us.max()]
        return times, apart, int((rows[:, 3] != 0).sum()), rows[:, 4].mean()


def compare(name, loop, arguments):
    candidates = settings(loop.horizon)
    good, ours, theirs, apart, iterations, reasons = [], [], {}, {}, {}, {}
    for setting in candidates:
        times, difference, failed, mean = loop.acados(setting, 1)
        if arguments.all:
            print(f"    {setting}: {three(times)} us, {difference:.0e}, {failed} failed, "
                  f"{mean:.2f} QPs", file=sys.stderr)
        if failed == 0 and difference <= arguments.tolerance:
            good.append((times[1], setting))
            apart[setting], iterations[setting], theirs[setting] = difference, mean, []
        else:
            reasons.setdefault(setting[0], []).append((failed, difference))
    best = {}
    for _, setting in sorted(good):
        best.setdefault(setting[0], []).append(setting)
    good = [setting for group in best.values() for setting in group[:arguments.keep]]
    for _ in range(arguments.rounds):
        metrics = loop.pinc()["control"][0]
        step = metrics["step_us"]
        mean = 1e6 * metrics["wall_s"]["median"] / len(loop.steps[0])
        ours.append([step["p50"], mean, step["p99"], step["max"]])
        for setting in good:
            theirs[setting].append(loop.acados(setting, loop.repetitions)[0])
    mine = np.median(ours, axis=0)
    for qp in ("daqp", "hpipm-full", "hpipm-partial"):
        group = [setting for setting in good if setting[0] == qp]
        if not group:
            failed, difference = min(reasons[qp])
            print(f"| {name}, {qp} | at best {failed} of {len(loop.steps[0])} steps fail "
                  f"| | | {difference:.0e} | |", flush=True)
            continue
        setting = min(group, key=lambda s: statistics.median(times[1] for times in theirs[s]))
        other = np.median(theirs[setting], axis=0)
        ratio = np.median(np.array(theirs[setting]) / np.array(ours), axis=0)
        print(f"| {name}, {describe(setting)} | {three(other)} | {three(mine)} | {three(ratio)} "
              f"| {apart[setting]:.0e} | {iterations[setting]:.2f}, "
              f"{metrics['sqp_iterations_mean']:.2f} |", flush=True)


def three(values):
    """Of three digits each."""
    return " / ".join(f"{v:.3g}" if v < 1000 else f"{v:.0f}" for v in values)


def describe(setting):
    qp, cond_n, mode, tolerance, _, first, shift = setting
    parts = [qp] if qp == "daqp" else [qp, mode, f"QPs to {tolerance:.0e}"]
    if qp == "hpipm-partial":
        parts.append(f"{cond_n} stages")
    parts.append({0: "first QP cold", 1: "first QP warm", 2: "first QP from the plan"}[first])
    return ", ".join(parts + ["shifted"] * shift)


def versions(source, installed, target):
    """What is compared, and with which settings."""
    git = lambda folder: run(["git", "-C", folder, "log", "-1", "--format=%h of %cs"]).strip()
    print(f"acados {git(source)}, " + ", ".join(
        f"{name} {git(source / 'external' / name)}" for name in ("blasfeo", "hpipm", "daqp")))
    print(f"BLASFEO target {target}, HPIPM AVX, -O3 -march=native; driver and models "
          f"{' '.join(COMPILER)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--acados", type=Path, required=True, help="checkout of acados")
    parser.add_argument("--build", type=Path, help="where to build it, by default in the checkout")
    parser.add_argument("--blasfeo-target", default="X64_INTEL_HASWELL")
    parser.add_argument("--pinc", default=str(TOP / "target/release/pinc"))
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--repetitions", type=int, default=10,
                        help="of the loop in a round; a fifth for long horizons")
    parser.add_argument("--keep", type=int, default=2, help="settings per QP solver that are timed")
    parser.add_argument("--training-s", type=float, default=5.0)
    parser.add_argument("--models", help="folder to keep the nets in, or to take them from")
    parser.add_argument("--tolerance", type=float, default=1e-6)
    parser.add_argument("--all", action="store_true", help="say what every setting does")
    arguments = parser.parse_args()
    build_folder = arguments.build or arguments.acados / f"build-{arguments.blasfeo_target}"
    installed = build(arguments.acados, build_folder.resolve(), arguments.blasfeo_target)
    versions(arguments.acados, installed, arguments.blasfeo_target)
    print("\n| loop, acados' setting | acados: median / mean / p99 / longest, us | pinc "
          "| times as long | inputs differ by | QPs a step: acados, pinc |\n"
          "|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.cases:
            compare(name, Loop(CASES[name], arguments, installed, Path(folder) / name), arguments)


if __name__ == "__main__":
    main()
