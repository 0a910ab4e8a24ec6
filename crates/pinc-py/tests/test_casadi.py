"""The model as a function of CasADi."""

from pathlib import Path

import numpy as np
import pytest

import pinc_nmpc as pinc

casadi = pytest.importorskip("casadi")

POINTS = np.random.default_rng(5).uniform([-2, -3, -1], [2, 3, 1], (20, 3))


def test_values_and_jacobians_match_the_model(model: pinc.Model) -> None:
    f = model.casadi("osc")
    assert (f.name(), f.name_in(), f.name_out()) == ("osc", ["x", "u"], ["x_next"])
    x, u = casadi.SX.sym("x", 2), casadi.SX.sym("u")
    y = f(x, u)
    slopes = casadi.Function("slopes", [x, u], [casadi.jacobian(y, x), casadi.jacobian(y, u)])
    for point in POINTS:
        following, a, b = model.linearize(point[:2], point[2:])
        assert np.abs(f(point[:2], point[2]).full().ravel() - following).max() < 1e-12
        found = [part.full() for part in slopes(point[:2], point[2])]
        assert np.abs(found[0] - a).max() < 1e-11 and np.abs(found[1] - b).max() < 1e-11


def test_ipopt_chooses_the_inputs_of_the_controller(model: pinc.Model, smoke: Path) -> None:
    """The control problem of the config with the net in SX, by multiple shooting."""
    f, n2 = model.casadi(), 5
    controller = pinc.Nmpc(smoke, model, overrides={"control.n2": n2, "control.nu": n2})
    x0, previous = casadi.SX.sym("x0", 2), casadi.SX.sym("previous")
    target = casadi.SX.sym("target", 2)
    unknowns, constraints, cost = [], [], 0
    at, before = x0, previous
    for j in range(n2):
        u, x = casadi.SX.sym(f"u{j}"), casadi.SX.sym(f"x{j + 1}", 2)
        unknowns += [u, x]
        constraints.append(f(at, u) - x)
        cost += 10 * casadi.sumsqr(x - target) + (u - before) ** 2
        at, before = x, u
    program = {
        "x": casadi.vertcat(*unknowns),
        "f": cost,
        "g": casadi.vertcat(*constraints),
        "p": casadi.vertcat(x0, previous, target),
    }
    options = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    options |= {"ipopt.tol": 1e-11, "ipopt.bound_relax_factor": 0.0}
    solver = casadi.nlpsol("solver", "ipopt", program, options)
    x, applied = np.array([0.5, 0.0]), 0.0
    for k in range(12):
        reference = [0.0, 0.0] if k < 6 else [-0.5, 0.0]
        step = controller.step(x, reference)
        assert step.status == "converged"
        answer = solver(x0=0, p=[*x, applied, *reference], lbx=-1, ubx=1, lbg=0, ubg=0)
        assert abs(float(answer["x"][0]) - step.u[0]) < 1e-6
        applied = step.u[0]
        x = model.step(x, step.u)


@pytest.mark.filterwarnings("ignore")
def test_do_mpc_simulates_the_model(model: pinc.Model) -> None:
    do_mpc = pytest.importorskip("do_mpc")
    simulator = do_mpc.simulator.Simulator(model.do_mpc())
    simulator.set_param(t_step=model.sample_time_s)
    simulator.setup()
    x = np.array([0.5, -0.2])
    simulator.x0 = x
    for u in (0.3, -0.7, 0.1):
        x = model.step(x, u)
        found = simulator.make_step(np.array([[u]]))
        assert np.abs(found.ravel() - x).max() < 1e-12
