"""acados' zero-order tightening (zoRO) of the plan of configs/robust/differential-drive.toml.

    ACADOS_SOURCE_DIR=acados python zoro.py ../../../configs/robust/differential-drive.toml ../../../crates/pinc/tests/suite/zoro.json

Gives acados, with its Python package, the plan that `../zoro.py` found, and prints how far the bounds
that it tightens along it are from the ones found with it. Model, integrator, disturbance and feedback
are the config's.
"""

import json
import sys
import tomllib
from statistics import NormalDist

import casadi as ca
import numpy as np
from acados_template import AcadosModel, AcadosOcp, AcadosOcpSolver, ZoroDescription

SUBSTEPS = 4
OBSTACLES = [(0.0, 1.0, 1.0), (3.0, 0.68, 0.7), (7.0, 1.2, 0.55)]
SPEED, RATE = 3, 4


def drive():
    x, u = ca.SX.sym("x", 5), ca.SX.sym("u", 2)
    model = AcadosModel()
    model.name, model.x, model.u = "drive", x, u
    model.f_expl_expr = ca.vertcat(x[3] * ca.cos(x[2]), x[3] * ca.sin(x[2]), x[4], u)
    distances = [ca.sqrt((x[0] - a) ** 2 + (x[1] - b) ** 2) for a, b, _ in OBSTACLES]
    model.con_h_expr = model.con_h_expr_e = ca.vertcat(*distances)
    return model


def solver(control, N):
    ocp, uncertainty = AcadosOcp(), control["uncertainty"]
    ocp.model = drive()
    ocp.cost.cost_type = ocp.cost.cost_type_e = "LINEAR_LS"
    ocp.cost.W, ocp.cost.W_e = np.diag(control["q"]), np.diag(control["q"][:5])
    ocp.cost.Vx, ocp.cost.Vx_e = np.eye(7, 5), np.eye(5)
    ocp.cost.Vu = np.eye(7, 2, -5)
    ocp.cost.yref, ocp.cost.yref_e = np.zeros(7), np.zeros(5)
    low, high, names = control["state_low"], control["state_high"], ("v", "omega")
    limits = ocp.constraints
    limits.idxbu, limits.lbu, limits.ubu = np.arange(2), *map(
        np.array, (control["input_low"], control["input_high"])
    )
    for end in ("", "_e"):
        setattr(limits, f"idxbx{end}", np.array([SPEED, RATE]))
        setattr(limits, f"lbx{end}", np.array([low[name] for name in names]))
        setattr(limits, f"ubx{end}", np.array([high[name] for name in names]))
        setattr(limits, f"lh{end}", np.array([radius for *_, radius in OBSTACLES]))
        setattr(limits, f"uh{end}", np.full(len(OBSTACLES), 1e3))
    limits.x0 = np.array(control["initial_state"])
    options = ocp.solver_options
    options.N_horizon, options.tf = N, N * control["step_s"]
    options.integrator_type, options.sim_method_num_stages = "ERK", 4
    options.sim_method_num_steps = SUBSTEPS
    options.qp_solver, options.nlp_solver_type = "PARTIAL_CONDENSING_HPIPM", "SQP_RTI"
    options.custom_update_filename = "custom_update_function.c"
    options.custom_update_header_filename = "custom_update_function.h"
    options.custom_update_copy = False
    options.custom_templates = [
        (f"custom_update_function_zoro_template.in.{kind}", f"custom_update_function.{kind}")
        for kind in "ch"
    ]
    zoro, places = ZoroDescription(), list(range(len(OBSTACLES)))
    zoro.backoff_scaling_gamma = NormalDist().inv_cdf(uncertainty["probability"])
    # In acados deviations go on by A - B K.
    zoro.fdbk_K_mat = -np.array(uncertainty["feedback"])
    zoro.unc_jac_G_mat, zoro.P0_mat = np.eye(5), np.zeros((5, 5))
    zoro.W_mat = np.diag(np.array(uncertainty["process_sd"]) ** 2)
    zoro.idx_lbx_t = zoro.idx_ubx_t = zoro.idx_lbx_e_t = zoro.idx_ubx_e_t = [0, 1]
    zoro.idx_lh_t = zoro.idx_lh_e_t = places
    ocp.zoro_description = zoro
    return AcadosOcpSolver(ocp, verbose=False), ocp


def main():
    with open(sys.argv[1], "rb") as file:
        control = tomllib.load(file)["control"]
    with open(sys.argv[2], encoding="utf-8") as file:
        expected = json.load(file)
    N = control["n2"]
    inputs = np.array(expected["inputs"]).reshape(N, 2)
    by_x = np.array(expected["states_by"]).reshape(N, 5)
    by_y = np.array(expected["outputs_by"]).reshape(N, len(OBSTACLES))
    acados, ocp = solver(control, N)
    x = np.array(control["initial_state"])
    f = ca.Function("f", [ocp.model.x, ocp.model.u], [ocp.model.f_expl_expr])
    h = control["step_s"] / SUBSTEPS
    acados.set(0, "lbx", x)
    acados.set(0, "ubx", x)
    for k in range(N + 1):
        acados.set(k, "x", x)
        if k < N:
            acados.set(k, "u", inputs[k])
            for _ in range(SUBSTEPS):
                slope = lambda at: f(at, inputs[k]).full().ravel()  # noqa: E731
                k1 = slope(x)
                k2 = slope(x + h / 2 * k1)
                k3 = slope(x + h / 2 * k2)
                k4 = slope(x + h * k3)
                x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    acados.options_set("rti_phase", 1)
    acados.solve()
    acados.custom_update(np.zeros(25))
    limits, worst = ocp.constraints, 0.0
    for k in range(1, N + 1):
        end = "_e" if k == N else ""
        moved = {side: acados.constraints_get(k, side) for side in ("lbx", "ubx", "lh")}
        for found, wanted in (
            (moved["lbx"].ravel() - getattr(limits, f"lbx{end}"), by_x[k - 1, [SPEED, RATE]]),
            (getattr(limits, f"ubx{end}") - moved["ubx"].ravel(), by_x[k - 1, [SPEED, RATE]]),
            (moved["lh"].ravel() - getattr(limits, f"lh{end}"), by_y[k - 1]),
        ):
            worst = max(worst, abs(found - wanted).max())
    print(f"bounds of {N} stages, tightened by up to {by_x[:, 3:].max():.3g}: off by {worst:.1e}")


main()
