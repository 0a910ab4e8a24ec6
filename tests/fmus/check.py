"""The oscillator as an FMU, distilled and controlled, beside its equation.

    python3 tests/fmus/check.py PINC SOURCES WORK

SOURCES are those of Modelica's reference FMUs. Their oscillator has no input: what is controlled is its
damping, the parameter mu, which a step may begin with. Prints a table; ends with an error where a net is
more than twice as wrong as one of the equation, or a loop's IAE differs by more than 0.1 %.
"""

import json
import pathlib
import shutil
import subprocess
import sys
import zipfile

PINC, SOURCES, WORK = (pathlib.Path(argument).resolve() for argument in sys.argv[1:])

CONFIG = """
name = "{name}"
preset = "ours"
seed = 1
{plant}
# A ninth of it, which a loop is looked at, is five internal steps of the reference FMU's own integrator.
[model]
horizon_s = 0.45
hidden_layers = 2
neurons = 16
[domain]
state_low = {state_low}
state_high = {state_high}
input_low = [{low}]
input_high = [{high}]
[training]
source = "integrator"
{training}
[validation]
duration_s = {scenario_s}
[validation.domain]
state_low = [-0.5, -0.5]
state_high = [0.5, 0.5]
input_low = [{low}]
input_high = [{high}]
[control]
models = ["pinc", "{model}"]
duration_s = 18.0
initial_state = {initial}
controlled = ["x1", "x2"]
q = [10.0, 10.0]
r = [1.0]
rk4_substeps = 16
input_low = [{low}]
input_high = [{high}]
references = [{{ start_s = 0.0, value = {value} }}]
"""

# The oscillator whose damping is the input, and the one of the paper, which a force pushes. The first
# runs away where the damping is negative and it is far out: what runs freely is short.
DAMPED = {
    "state_low": [-1.2, -1.2], "state_high": [1.2, 1.2], "low": -2.0, "high": 0.5, "scenario_s": 1.8,
    "initial": [0.8, 0.0], "value": [0.0, 0.0],
}
PUSHED = {
    "state_low": [-3.0, -4.35], "state_high": [3.0, 4.35], "low": -1.0, "high": 1.0, "scenario_s": 9.0,
    "initial": [1.0, 0.0], "value": [-0.5, 0.0],
}

EXPRESSION = """
[plant.expression]
states = ["x1", "x2"]
inputs = ["u"]
derivatives = {{ x1 = "x2", x2 = "{right}" }}
"""
EQUATIONS = {
    "damped": (DAMPED, EXPRESSION.format(right="u*(1 - x1^2)*x2 - x1")),
    "pushed": (PUSHED, EXPRESSION.format(right="(1 - x1^2)*x2 - x1 + u")),
}

FMU = """
[plant.fmu]
file = "{file}"
kind = "{kind}"
states = ["x1", "x2"]
inputs = ["u"]
"""
REFERENCE = 'variables = { x1 = "x0", x2 = "x1", u = "mu" }\n'
OWN = 'start_variables = { x1 = "x1_start", x2 = "x2_start" }\n'


def call(*arguments):
    subprocess.run([str(argument) for argument in arguments], check=True, cwd=WORK)


def build(version):
    """The reference FMU of this version, for Linux."""
    folder = WORK / f"reference-{version}"
    binaries = folder / "binaries" / ("linux64" if version == 2 else "x86_64-linux")
    shutil.rmtree(folder, ignore_errors=True)
    binaries.mkdir(parents=True)
    model = SOURCES / "VanDerPol"
    code = [SOURCES / "src" / f"fmi{version}Functions.c", SOURCES / "src" / "cosimulation.c", model / "model.c"]
    call(
        "cc", "-O2", "-shared", "-fPIC", f"-DFMI_VERSION={version}", "-DDISABLE_PREFIX", "-I", model, "-I",
        SOURCES / "include", *code, "-lm", "-o", binaries / "VanDerPol.so",
    )
    shutil.copy(model / f"FMI{version}.xml", folder / "modelDescription.xml")
    path = WORK / f"reference-{version}.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*")):
            archive.write(file, file.relative_to(folder))
    return path


def export(version):
    """Our own plant as an FMU of this version."""
    config = pathlib.Path(__file__).parents[2] / "configs/van-der-pol/control.toml"
    more = ["--fmi3"] if version == 3 else []
    folder = WORK / f"own-{version}"
    call(PINC, "export", config, "--plant", "--to", "fmu", "--name", "osc", "--out", folder, *more)
    return folder / "osc.fmu"


def run(name, values, plant, model, training=""):
    config = WORK / f"{name}.toml"
    config.write_text(CONFIG.format(name=name, plant=plant, model=model, training=training, **values))
    out = WORK / "runs" / name
    shutil.rmtree(out, ignore_errors=True)
    call(PINC, "run", config, "--allow-process", "--quiet", "--out", out)
    metrics = json.loads((out / "metrics.json").read_text())
    net, other = metrics["control"]
    rms = metrics["validation"]["domain_error"]["rms"]
    line = f"{name:24} {rms:8.1e} {net['iae_dense_sum']:9.4f} {other['iae_dense_sum']:9.4f}"
    times = [of["step_us"]["p50"] for of in (net, other)]
    print(f"{line} {times[0]:9.1f} {times[1]:9.1f}", flush=True)
    return rms, net["iae_dense_sum"], other["iae_dense_sum"]


def main():
    print(f"{'plant':24} {'net, rms':8} {'IAE, net':>9} {'other':>9} {'net, us':>9} {'other':>9}")
    truth = {
        name: run(f"equation-{name}", values, plant, "rk4")
        for name, (values, plant) in EQUATIONS.items()
    }
    plants = [
        (f"reference-{version}-{kind}", "damped", build(version), kind, REFERENCE)
        for version in (2, 3)
        for kind in ("model-exchange", "co-simulation")
    ]
    # The same with differences in place of its directional derivatives.
    differences = REFERENCE + "directional_derivatives = false\n"
    plants.append(("reference-2-differences", "damped", WORK / "reference-2.fmu", "model-exchange", differences))
    plants += [(f"own-{version}", "pushed", export(version), "co-simulation", OWN) for version in (2, 3)]
    wrong = []
    for name, equation, file, kind, names in plants:
        plant = FMU.format(file=file, kind=kind) + names
        rms, *iae = run(name, EQUATIONS[equation][0], plant, "black-box")
        of_equation, *expected = truth[equation]
        if rms > 2 * of_equation:
            wrong.append(f"{name}: rms {rms} beside {of_equation}")
        # The reference FMUs' own integrator is Euler's method with steps of 10 ms: another plant.
        if name.startswith("reference") and kind == "co-simulation":
            continue
        for found, right in zip(iae, expected):
            if abs(found - right) > 1e-3 * right:
                wrong.append(f"{name}: IAE {found} beside {right}")
    # Fitted to derivatives too: the equation's and the FMU's.
    values, plant = EQUATIONS["damped"]
    fmu = FMU.format(file=WORK / "reference-2.fmu", kind="model-exchange") + REFERENCE
    derivatives = "derivatives = 0.1"
    of_equation, *_ = run("equation-derivatives", values, plant, "rk4", derivatives)
    rms, *_ = run("reference-2-derivatives", values, fmu, "black-box", derivatives)
    if rms > 2 * of_equation:
        wrong.append(f"with derivatives: rms {rms} beside {of_equation}")
    if wrong:
        sys.exit("\n".join(wrong))


main()
