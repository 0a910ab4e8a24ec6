"""Checks what `pinc export` writes with the programs that it is for: CasADi, do-mpc, ONNX Runtime, FMPy and
another importer of FMUs.

    python3 tests/exports/check.py PINC WORK

PINC is the program, WORK a directory for files. `.ci/exports` installs the packages and runs this.
"""

import csv
import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import casadi
import do_mpc
import fmpy
import fmpy.validation
import numpy as np
import onnx
import onnxruntime
from do_mpc.sysid import ONNXConversion
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmuloader.fmi2 import Fmi2Slave, Fmi2Type
from fmuloader.fmi3 import Fmi3Slave

PINC, WORK = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
TOP = Path(__file__).resolve().parents[2]
CONFIG = TOP / "configs/van-der-pol/control.toml"
T = 0.5
POINTS = 9  # of a dense trace per step
FAILED = []


def pinc(*arguments):
    """Runs the program; returns what it writes."""
    done = subprocess.run([PINC, *map(str, arguments)], check=True, text=True, capture_output=True)
    return done.stdout


def report(what, found, allowed):
    """Prints a check and remembers if it failed."""
    good = bool(found <= allowed)
    print(f"{'ok    ' if good else 'FAILED'}  {what}: {found:.2e}, allowed {allowed:.0e}", flush=True)
    if not good:
        FAILED.append(what)


def read(path):
    """A CSV file as lists by column."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    return {key: [row[key] for row in rows] for key in rows[0]}


def numbers(table, *names):
    """Columns of a table as an array."""
    return np.array([[float(v) for v in table[name]] for name in names]).T


def one_step(model, points):
    """The net's states after T from points (x1, x2, u), by `pinc predict`."""
    given, found = WORK / "points.csv", WORK / "steps.csv"
    with open(given, "w") as file:
        file.write("scenario,t,u,x1,x2\n")
        for i, (x1, x2, u) in enumerate(points):
            file.write(f"{i},0,{u!r},{x1!r},{x2!r}\n{i},{T},{u!r},,\n")
    pinc("predict", "--model", model, "--inputs", given, "--output", found)
    return numbers(read(found), "x1", "x2")[1::2]


def random_points(count):
    low, high = np.array([-2.5, -3.5, -1.0]), np.array([2.5, 3.5, 1.0])
    return np.random.default_rng(1).uniform(low, high, (count, 3)).tolist()


def check_onnx(model):
    """The checker, and ONNX Runtime against the program, in parts of the largest state."""
    points = np.array(random_points(20_000), np.float32).astype(float)
    expected = one_step(model, points.tolist())
    for double, dtype, allowed in [(True, np.float64, 1e-13), (False, np.float32, 1e-5)]:
        out = WORK / f"onnx-{double}"
        flags = ["--double"] if double else []
        pinc("export", "--model", model, "--to", "onnx", "--name", "osc", "--out", out, *flags)
        onnx.checker.check_model(onnx.load(out / "osc.onnx"), full_check=True)
        session = onnxruntime.InferenceSession(str(out / "osc.onnx"))
        given = {"x": points[:, :2].astype(dtype), "u": points[:, 2:].astype(dtype)}
        (found,) = session.run(["x_next"], given)
        off = np.abs(found - expected).max() / np.abs(expected).max()
        report(f"ONNX Runtime, {dtype.__name__}", off, allowed)


def check_casadi(model):
    """Values, derivatives, and IPOPT in the loop against `pinc control`."""
    out = WORK / "casadi"
    pinc("export", "--model", model, "--to", "casadi", "--name", "osc", "--out", out)
    library = out / "osc.so"
    subprocess.run(
        ["cc", "-O2", "-shared", "-fPIC", "osc_casadi.c", "-lm", "-o", library], cwd=out, check=True
    )
    f = casadi.external("osc", str(library))
    points = random_points(50)
    found = np.array([np.array(f(p[:2], p[2])).ravel() for p in points])
    report("CasADi, values", np.abs(found - one_step(model, points)).max(), 1e-12)

    x, u = casadi.MX.sym("x", 2), casadi.MX.sym("u")
    xu = casadi.vertcat(x, u)
    jacobian = casadi.Function("J", [x, u], [casadi.jacobian(f(x, u), xu)])
    weights = casadi.DM([0.7, -1.3])
    hessian, _ = casadi.hessian(casadi.dot(weights, f(x, u)), xu)
    hessian = casadi.Function("H", [x, u], [hessian])
    worst_j = worst_h = 0.0
    h = 1e-5
    for p in points[:10]:
        j = np.array(jacobian(p[:2], p[2]))
        second = np.array(hessian(p[:2], p[2]))
        for k in range(3):
            up, down = (np.array(p) + s * h * np.eye(3)[k] for s in (1, -1))
            slope = np.array(f(up[:2], up[2]) - f(down[:2], down[2])).ravel() / (2 * h)
            worst_j = max(worst_j, np.abs(j[:, k] - slope).max())
            of_j = np.array(jacobian(up[:2], up[2]) - jacobian(down[:2], down[2])) / (2 * h)
            worst_h = max(worst_h, np.abs(second[:, k] - np.array(weights).ravel() @ of_j).max())
    report("CasADi, Jacobian against differences", worst_j, 1e-8)
    report("CasADi, Hessian against differences", worst_h, 1e-8)
    check_ipopt(model, f, "the external")


def check_ipopt(model, f, what):
    """The oscillator's control problem by IPOPT with the net as `what`, at the states of the loop of
    `pinc control`."""
    states, inputs, references, spec = closed_loop(model)
    n2, bounds = spec["n2"], 1.0
    nlp_x, cost, g = [], 0, []
    x0, previous = casadi.MX.sym("x0", 2), casadi.MX.sym("previous")
    reference = casadi.MX.sym("reference", 2, n2)
    before, at = previous, x0
    for j in range(n2):
        u, x = casadi.MX.sym(f"u{j}"), casadi.MX.sym(f"x{j + 1}", 2)
        nlp_x += [u, x]
        g.append(f(at, u) - x)
        error = x - reference[:, j]
        cost += 10 * casadi.dot(error, error) + (u - before) ** 2
        before, at = u, x
    p = casadi.vertcat(x0, previous, casadi.vec(reference))
    nlp = {"x": casadi.vertcat(*nlp_x), "f": cost, "g": casadi.vertcat(*g), "p": p}
    quiet = {"ipopt.print_level": 0, "print_time": False, "ipopt.tol": 1e-11, "ipopt.sb": "yes"}
    # Bounds as they are, not relaxed by IPOPT.
    quiet["ipopt.bound_relax_factor"] = 0.0
    solver = casadi.nlpsol("solver", "ipopt", nlp, quiet)
    worst, u_before = 0.0, 0.0
    for k in range(0, 30):
        window = np.array([references[min(k + j, len(references) - 1)] for j in range(n2)])
        given = np.concatenate([states[k], [u_before], window.ravel()])
        answer = solver(x0=0, p=given, lbx=-bounds, ubx=bounds, lbg=0, ubg=0)
        worst = max(worst, abs(float(answer["x"][0]) - inputs[k][0]))
        u_before = inputs[k][0]
    report(f"IPOPT with {what}, inputs of the loop", worst, 1e-6)


LOOP = {}


def closed_loop(model):
    """States, inputs and references at the steps of the loop of `pinc control`."""
    if "loop" not in LOOP:
        out = WORK / "loop"
        pinc("control", CONFIG, "--model", model, "--only", "pinc", "--out", out)
        table = read(out / "control.csv")
        rows = slice(0, -1, POINTS)
        states, inputs = numbers(table, "x1", "x2")[rows], numbers(table, "u")[rows]
        # A row has the reference that led there.
        references = numbers(table, "x1_ref", "x2_ref")[1::POINTS]
        spec = tomllib.loads((out / "config.toml").read_text())["control"]
        LOOP["loop"] = states, inputs, references, spec
    return LOOP["loop"]


def check_do_mpc(model):
    """do-mpc: its conversion of the ONNX file, and its controller with the external."""
    conversion = ONNXConversion(onnx.load(WORK / "onnx-True" / "osc.onnx"))
    x, u = casadi.SX.sym("x", 1, 2), casadi.SX.sym("u", 1, 1)
    conversion.convert(x=x, u=u)
    converted = casadi.Function("f", [x, u], [conversion["x_next"]])
    points = random_points(20)
    found = [np.array(converted(casadi.DM([p[:2]]), p[2])).ravel() for p in points]
    report("do-mpc's conversion", np.abs(np.array(found) - one_step(model, points)).max(), 1e-12)

    point, force = casadi.SX.sym("point", 2), casadi.SX.sym("force")
    symbolic = casadi.Function("symbolic", [point, force], [converted(point.T, force).T])
    check_ipopt(model, symbolic, "SX")

    external = casadi.external("osc", str(WORK / "casadi" / "osc.so"))
    states, inputs, _, spec = closed_loop(model)
    plant = do_mpc.model.Model("discrete", "MX")
    state = plant.set_variable("_x", "x", shape=(2, 1))
    plant.set_rhs("x", external(state, plant.set_variable("_u", "u")))
    plant.setup()
    controller = do_mpc.controller.MPC(plant)
    tight = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-11,
             "ipopt.bound_relax_factor": 0.0}
    controller.set_param(n_horizon=spec["n2"], t_step=T, n_robust=0, nlpsol_opts=tight,
                         store_full_solution=False)
    cost = 10 * casadi.dot(plant.x["x"], plant.x["x"])
    controller.set_objective(mterm=cost, lterm=cost)
    controller.set_rterm(u=1.0)
    for side, bound in (("lower", -1.0), ("upper", 1.0)):
        controller.bounds[side, "_x", "x"] = bound
        controller.bounds[side, "_u", "u"] = bound
    controller.setup()
    controller.x0, controller.u0 = states[0], np.zeros((1, 1))
    controller.set_initial_guess()
    worst = 0.0
    # The reference is 0 until the preview sees the first change, at step 30.
    for k in range(20):
        found = float(np.array(controller.make_step(states[k].reshape(2, 1))).ravel()[0])
        worst = max(worst, abs(found - inputs[k][0]))
    report("do-mpc with the external, inputs of the loop", worst, 1e-6)


class Slave:
    """An FMU of FMI 2.0 or 3.0, opened."""

    def __init__(self, path):
        self.directory = fmpy.extract(str(path))
        description = fmpy.read_model_description(str(path))
        self.variables = description.modelVariables
        self.vr = {v.name: v.valueReference for v in self.variables}
        self.is_two = description.fmiVersion == "2.0"
        self.fmu = (FMU2Slave if self.is_two else FMU3Slave)(
            guid=description.guid,
            unzipDirectory=self.directory,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="slave",
        )
        self.fmu.instantiate()
        if self.is_two:
            self.fmu.setupExperiment(startTime=0.0)

    def begin(self):
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def references(self, what):
        """The value references of what a plant or a controller has: `x`, `u`, `reference`, `y`,
        `x_start` or `x_estimate`, in order."""
        is_controller = "status" in self.vr
        causality, ending = {
            "x": ("input" if is_controller else "output", ""),
            "y": ("input", ""),
            "u": ("output" if is_controller else "input", ""),
            "reference": ("input", "_ref"),
            "x_start": ("parameter", "_start"),
            "x_estimate": ("output", "_estimate"),
        }[what]
        endings = ("_ref", "_start", "_estimate")

        def is_it(variable):
            own = next((end for end in endings if variable.name.endswith(end)), "")
            return variable.type in ("Real", "Float64") and variable.causality == causality and own == ending

        return [variable.valueReference for variable in self.variables if is_it(variable)]

    def set(self, name, values):
        set = self.fmu.setReal if self.is_two else self.fmu.setFloat64
        set(self.references(name), list(values))

    def get(self, name, count):
        get = self.fmu.getReal if self.is_two else self.fmu.getFloat64
        return get(self.references(name)[:count])

    def status(self, name="status"):
        get = self.fmu.getInteger if self.is_two else self.fmu.getInt64
        return get([self.vr[name]])[0]

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.directory, ignore_errors=True)


def check_validity(path):
    """FMPy's validator finds nothing."""
    problems = fmpy.validation.validate_fmu(str(path))
    for problem in problems:
        print(problem)
    report(f"FMPy validates {path.name}", len(problems), 0)


def check_fmu(model):
    """A free run against `pinc predict`, also rebuilt from the sources."""
    out = WORK / "fmu"
    pinc("export", "--model", model, "--to", "fmu", "--name", "osc", "--out", out)
    path = out / "osc.fmu"
    check_validity(path)
    given, expected = WORK / "run.csv", WORK / "run-out.csv"
    rng = np.random.default_rng(2)
    times = [0.0, 0.5, 0.7, 1.0, 1.5, 1.75, 2.25, 2.5, 3.0, 4.5, 6.0]
    inputs = rng.uniform(-1, 1, len(times)).tolist()
    with open(given, "w") as file:
        file.write("scenario,t,u,x1,x2\n")
        for i, (t, u) in enumerate(zip(times, inputs)):
            file.write(f"a,{t!r},{u!r}," + ("0.8,-0.3\n" if i == 0 else ",\n"))
    pinc("predict", "--model", model, "--inputs", given, "--output", expected)
    expected = numbers(read(expected), "x1", "x2")
    for rebuilt in (False, True):
        if rebuilt:
            # With the compiler of this machine, by CMake.
            command = [sys.executable, "-m", "fmpy", "compile", path]
            subprocess.run(command, check=True, capture_output=True)
        slave = Slave(path)
        slave.set("x_start", [0.8, -0.3])
        slave.begin()
        found = [slave.get("x", 2)]
        for t, end, u in zip(times, times[1:], inputs):
            slave.set("u", [u])
            slave.fmu.doStep(t, end - t)
            found.append(slave.get("x", 2))
        slave.close()
        what = "FMU of the net, rebuilt" if rebuilt else "FMU of the net"
        report(f"{what}, a free run", np.abs(np.array(found) - expected).max(), 1e-12)
    start = {"x1_start": 0.8, "x2_start": -0.3, "u": 0.25}
    result = fmpy.simulate_fmu(
        str(path), stop_time=2.0, step_size=0.125, output_interval=0.125, start_values=start
    )
    with open(given, "w") as file:
        file.write("scenario,t,u,x1,x2\n")
        for i in range(17):
            file.write(f"a,{0.125 * i!r},0.25," + ("0.8,-0.3\n" if i == 0 else ",\n"))
    pinc("predict", "--model", model, "--inputs", given, "--output", WORK / "run-out.csv")
    expected = numbers(read(WORK / "run-out.csv"), "x1", "x2")
    found = np.array([result["x1"], result["x2"]]).T
    report("FMPy simulates the net", np.abs(found - expected).max(), 1e-12)


def check_fmi3(model):
    """Compares a free run of the FMUs of FMI 3.0 and 2.0, and runs the validator on all kinds."""
    out = WORK / "fmi3"
    flags = ["--to", "fmu", "--fmi3", "--name"]
    pinc("export", "--model", model, *flags, "osc", "--out", out)
    pinc("export", CONFIG, "--model", model, *flags, "ctl", "--out", out)
    pinc("export", CONFIG, "--plant", *flags, "plant", "--out", out)
    for name in ("osc", "ctl", "plant"):
        check_validity(out / f"{name}.fmu")
    results = []
    for path in (WORK / "fmu" / "osc.fmu", out / "osc.fmu"):
        result = fmpy.simulate_fmu(str(path), stop_time=3.0, step_size=0.125, output_interval=0.125)
        results.append(np.array([result["x1"], result["x2"]]))
    report("FMU of FMI 3.0 against FMI 2.0", np.abs(results[0] - results[1]).max(), 1e-15)


def check_controller_fmu(model):
    """The controller's FMU at the states of the loop."""
    out = WORK / "controller"
    pinc("export", CONFIG, "--model", model, "--to", "fmu", "--name", "ctl", "--out", out)
    path = out / "ctl.fmu"
    check_validity(path)
    states, inputs, references, spec = closed_loop(model)
    slave = Slave(path)
    slave.begin()
    worst, compared = 0.0, 0
    for k, (x, u) in enumerate(zip(states, inputs)):
        # The slave holds a reference over the horizon: the first segment is compared.
        if k + spec["n2"] >= 30:
            break
        slave.set("x", [9.0, 9.0])
        slave.get("u", 1)  # too early: what is set afterwards counts
        slave.set("x", x)
        slave.set("reference", references[k])
        worst = max(worst, abs(slave.get("u", 1)[0] - u[0]))
        slave.fmu.doStep(k * T, 0.2)
        slave.fmu.doStep(k * T + 0.2, T - 0.2)
        compared += 1
    slave.close()
    report(f"FMU of the controller, {compared} steps of the loop", worst, 1e-8)


def check_loop_of_fmus(model):
    """Plant and controller as FMUs, closed, against `pinc control` without preview."""
    loop = WORK / "held"
    held = ["--set", "control.preview=false", "--set", "control.repetitions=1"]
    pinc("control", CONFIG, "--model", model, "--only", "pinc", "--out", loop, *held)
    table = read(loop / "control.csv")
    states, inputs = numbers(table, "x1", "x2"), numbers(table, "u")
    references = numbers(table, "x1_ref", "x2_ref")[1::POINTS]
    out = WORK / "plant"
    pinc("export", CONFIG, "--plant", "--to", "fmu", "--name", "osc", "--out", out)
    check_validity(out / "osc.fmu")
    plant, controller = Slave(out / "osc.fmu"), Slave(WORK / "controller" / "ctl.fmu")
    plant.begin()
    controller.begin()
    worst_x = worst_u = 0.0
    for k, reference in enumerate(references):
        controller.set("x", plant.get("x", 2))
        controller.set("reference", reference)
        u = controller.get("u", 1)
        worst_u = max(worst_u, abs(u[0] - inputs[POINTS * k][0]))
        plant.set("u", u)
        for part in range(2):
            t = (k + part / 2) * T
            plant.fmu.doStep(t, T / 2)
            controller.fmu.doStep(t, T / 2)
        end = np.abs(np.array(plant.get("x", 2)) - states[POINTS * (k + 1)]).max()
        worst_x = max(worst_x, end)
    plant.close()
    controller.close()
    report(f"FMUs of plant and controller, {len(references)} steps, states", worst_x, 1e-7)
    report("FMUs of plant and controller, inputs", worst_u, 1e-7)


def check_exchange():
    """FMPy integrates plants by their derivatives: as they integrate themselves."""
    for config in (CONFIG, TOP / "configs/gallery/van-de-vusse.toml"):
        for flags in ([], ["--fmi3"]):
            out = WORK / "exchange"
            pinc("export", config, "--plant", "--to", "fmu", *flags, "--name", "plant", "--out", out)
            check_validity(out / "plant.fmu")
            kinds = ("CoSimulation", "ModelExchange")
            options = {"stop_time": 20.0, "output_interval": 0.5, "relative_tolerance": 1e-10}
            results = [fmpy.simulate_fmu(str(out / "plant.fmu"), fmi_type=kind, **options) for kind in kinds]
            found, expected = (np.array(result.tolist()) for result in results)
            off = (np.abs(found - expected) / (1.0 + np.abs(expected))).max()
            report(f"model exchange, {config.stem} {' '.join(flags)}", off, 1e-6)


def check_other_importer():
    """fmuloader steps plants and controllers as FMPy does. Of FMI 2.0 it loads only what can do model
    exchange too, which a controller cannot."""
    for flags in (["--plant"], ["--plant", "--fmi3"], ["--only", "rk4", "--fmi3"]):
        path = WORK / "other" / "a.fmu"
        pinc("export", CONFIG, *flags, "--to", "fmu", "--name", "a", "--out", path.parent)
        slave = Slave(path)
        if slave.is_two:
            other = Fmi2Slave(path, model_identifier="a")
            other.instantiate("a", Fmi2Type.CO_SIMULATION, guid=slave.fmu.guid)
            other.setup_experiment()
            get, set = other.get_real, other.set_real
        else:
            other = Fmi3Slave(path, model_identifier="a")
            other.instantiate_co_simulation("a", instantiation_token=slave.fmu.guid)
            get, set = other.get_float64, other.set_float64
        slave.begin()
        other.enter_initialization_mode()
        other.exit_initialization_mode()
        given, read = ("u", "x") if "--plant" in flags else ("x", "u")
        worst, references = 0.0, slave.references(given)
        for k in range(20):
            values = np.sin(np.arange(len(references)) + k)
            slave.set(given, values)
            set(references, values.tolist())
            slave.fmu.doStep(k * T, T)
            other.do_step(k * T, T)
            found = np.array(get(slave.references(read)))
            worst = max(worst, np.abs(found - slave.get(read, len(found))).max())
        slave.close()
        other.free_instance()
        report(f"fmuloader, {' '.join(flags)}", worst, 0.0)


# Loops without preview, as an FMU has none: a config, and what is changed of it.
WHOLE_LOOPS = {
    "hover": ("tests/exports/hover.toml", []),
    "hover, delayed": ("tests/exports/hover.toml", ["control.delay_steps=2"]),
    # The first plan does not keep the bound on the tip and its distance, the others do.
    "hover, in a tube": (
        "tests/exports/hover.toml",
        [
            "control.uncertainty={ probability = 0.95, process_sd = [0.05, 0.01, 0.01, 0.01] }",
            "control.initial_state=[1.35, 0.5, 0.2, 0.0]",
        ],
    ),
}
# All shipped configs whose controllers C can be made of.
with open(TOP / "docs/tables/ways-out/configs.csv", newline="") as file:
    for row in csv.DictReader(file):
        if row["C, FMU"] == "same":
            path = Path(row["config"].strip("`"))
            WHOLE_LOOPS[f"{path.parent.name}, {path.stem}"] = (path, [])


def check_whole_loops():
    """Controllers with RK4, of FMI 2.0 and 3.0, given what the controller in the loop of `pinc
    control` was given: all of its inputs, from the first step on."""
    for what, (config, changes) in WHOLE_LOOPS.items():
        own = ["--only", "rk4"]
        for change in ["control.preview=false", "control.repetitions=1", *changes]:
            own += ["--set", change]
        out = WORK / "whole" / what.replace(", ", "-")
        pinc("control", TOP / config, *own, "--out", out)
        for version, flags in (("2.0", []), ("3.0", ["--fmi3"])):
            folder = out / f"fmi-{version}"
            flags = ["--to", "fmu", *flags, "--name", "ctl", "--out", folder]
            pinc("export", TOP / config, *own, *flags)
            check_validity(folder / "ctl.fmu")
            worst = whole_loop(Slave(folder / "ctl.fmu"), out)
            report(f"FMU of FMI {version}, {what}, the whole loop", worst, 1e-9)


def whole_loop(slave, out):
    """The largest difference of an input, relative to 1 + |u|, from the loop in `out`."""
    spec = tomllib.loads((out / "config.toml").read_text())["control"]
    trace, statuses = read(out / "control.csv"), read(out / "steps.csv")["status"]
    steps = len(statuses)
    # The trace begins with t, the states and the inputs. A row has the reference that led there.
    columns = list(trace)
    references = numbers(trace, *(f"{name}_ref" for name in spec["controlled"]))[1::POINTS]
    nx, nu = len(spec["initial_state"]), len(spec["input_low"])
    acted = numbers(trace, *columns[1 + nx : 1 + nx + nu])[: POINTS * steps : POINTS]
    if "estimator" in spec:
        name, estimates = "y", read(out / "estimates.csv")
        measured = numbers(estimates, *(key for key in estimates if key.startswith("y_")))
    else:
        name, measured = "x", numbers(trace, *columns[1 : 1 + nx])[: POINTS * steps : POINTS]
    delay, step_s = spec.get("delay_steps", 0), float(trace["t"][POINTS])
    slave.begin()
    worst, without_room = 0.0, 0
    for k, status in enumerate(statuses):
        slave.set(name, measured[k])
        slave.set("reference", references[k])
        u = np.array(slave.get("u", nu))
        if k + delay < steps:
            worst = max(worst, (np.abs(u - acted[k + delay]) / (1 + np.abs(u))).max())
        if (slave.status() == 0) != (status == "converged"):
            print(f"step {k}: status {slave.status()}, of `pinc control` {status}")
            worst = np.inf
        if "tube" in slave.vr:
            without_room += slave.status("tube") == 0
        slave.fmu.doStep(k * step_s, step_s)
    tube = json.loads((out / "metrics.json").read_text())["control"][0].get("tube")
    if tube is not None and tube["without_room"] != without_room:
        print(f"{without_room} plans do not fit, of `pinc control` {tube['without_room']}")
        worst = np.inf
    slave.close()
    return worst


class Server:
    """`pinc serve`, a step per call."""

    def __init__(self, *arguments):
        pipe = subprocess.PIPE
        command = [PINC, "serve", *map(str, arguments)]
        self.process = subprocess.Popen(command, text=True, stdin=pipe, stdout=pipe)

    def step(self, y, reference):
        print(json.dumps({"y": list(y), "reference": list(reference)}), file=self.process.stdin, flush=True)
        return json.loads(self.process.stdout.readline())

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def check_estimating_fmus(kind):
    """A controller with its estimator and the plant as FMUs, against `pinc serve` beside them."""
    config, out = TOP / "configs/estimation/tanks.toml", WORK / f"estimating-{kind}"
    own = ["--only", "rk4", "--set", f"control.estimator.kind={kind}"]
    own += ["--set", "control.estimator.window=10"] if kind == "mhe" else []
    pinc("export", config, *own, "--to", "fmu", "--name", "tanks", "--out", out / "controller")
    pinc("export", config, "--plant", "--to", "fmu", "--name", "tanks", "--out", out / "plant")
    pinc("export", config, *own, "--to", "fmu", "--fmi3", "--name", "tanks", "--out", out / "three")
    for folder in ("controller", "three"):
        check_validity(out / folder / "tanks.fmu")
    plant, controller = Slave(out / "plant" / "tanks.fmu"), Slave(out / "controller" / "tanks.fmu")
    server = Server(config, *own)
    plant.begin()
    controller.begin()
    rng = np.random.default_rng(5)
    worst_u = worst_x = 0.0
    for k in range(100):
        y = np.array(plant.get("x", 4))[:2] + rng.uniform(-0.05, 0.05, 2)
        reference = [12.4, 12.7] if k < 50 else [13.4, 13.2]
        controller.set("y", y)
        controller.set("reference", reference)
        u = controller.get("u", 2)
        answer = server.step(y, reference)
        worst_u = max(worst_u, np.abs(np.array(answer["u"]) - u).max())
        worst_x = max(worst_x, np.abs(np.array(answer["x"]) - controller.get("x_estimate", 4)).max())
        plant.set("u", u)
        plant.fmu.doStep(k * 10.0, 10.0)
        controller.fmu.doStep(k * 10.0, 10.0)
    end = np.abs(np.array(plant.get("x", 2)) - [13.4, 13.2]).max()
    plant.close()
    controller.close()
    server.close()
    report(f"FMU with an estimator, {kind}, against pinc serve, inputs", worst_u, 1e-8)
    report(f"FMU with an estimator, {kind}, against pinc serve, estimates", worst_x, 1e-8)
    report(f"FMU with an estimator, {kind}, worn pumps, levels at the end", end, 0.1)


def main():
    WORK.mkdir(parents=True, exist_ok=True)
    net = WORK / "net"
    model = net / "model.safetensors"
    if not model.exists():
        pinc("train", TOP / "configs/van-der-pol/main.toml", "--out", net, "--quiet")
    print(json.dumps({"casadi": casadi.__version__, "onnxruntime": onnxruntime.__version__,
                      "onnx": onnx.__version__, "fmpy": fmpy.__version__, "do_mpc": do_mpc.__version__}))
    check_onnx(model)
    check_casadi(model)
    check_do_mpc(model)
    check_fmu(model)
    check_controller_fmu(model)
    check_loop_of_fmus(model)
    check_fmi3(model)
    check_exchange()
    check_other_importer()
    check_whole_loops()
    check_estimating_fmus("ekf")
    check_estimating_fmus("mhe")
    if FAILED:
        sys.exit(f"{len(FAILED)} checks failed")
    print("all checks passed")


if __name__ == "__main__":
    main()
