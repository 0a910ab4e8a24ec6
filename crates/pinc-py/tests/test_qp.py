"""Quadratic programs."""

import numpy as np
import pytest

import pinc_nmpc as pinc
from pinc_nmpc.qp import register, solve_qp


def test_solutions_meet_the_conditions_of_optimality() -> None:
    rng = np.random.default_rng(4)
    for n, inequalities, equalities in ((3, 0, 0), (8, 12, 2), (20, 30, 5)):
        root = rng.normal(size=(n, n))
        P, q = root @ root.T + np.eye(n), 5 * rng.normal(size=n)
        G, A = rng.normal(size=(inequalities, n)), rng.normal(size=(equalities, n))
        inside = rng.uniform(-0.5, 0.5, n)
        h, b = G @ inside + 0.1, A @ inside
        lb, ub = -np.ones(n), np.ones(n)
        found = solve_qp(P, q, G, h, A, b, lb, ub)
        assert found is not None
        x, z, y, z_box = found
        assert np.abs(P @ x + q + G.T @ z + A.T @ y + z_box).max() < 1e-9
        assert (G @ x <= h + 1e-9).all() and np.abs(A @ x - b).max(initial=0) < 1e-9
        assert (np.abs(x) <= 1 + 1e-9).all() and (z >= 0).all()
        assert np.abs(z * (h - G @ x)).max(initial=0) < 1e-8
        assert np.abs(np.minimum(z_box, 0) * (x - lb)).max() < 1e-8
        assert np.abs(np.maximum(z_box, 0) * (ub - x)).max() < 1e-8


def test_programs_without_a_solution_and_wrong_shapes() -> None:
    assert solve_qp(np.eye(1), [0.0], lb=[1.0], ub=[2.0], A=[[1.0]], b=[3.0]) is None
    with pytest.raises(pinc.InputError, match="G: expected a matrix with 1 columns"):
        solve_qp(np.eye(1), [0.0], G=[[1.0, 2.0]], h=[1.0])
    with pytest.raises(pinc.InputError, match="P: expected"):
        solve_qp(np.eye(2), [0.0])


def test_it_is_a_solver_of_qpsolvers() -> None:
    qpsolvers = pytest.importorskip("qpsolvers")
    register()
    register()
    assert qpsolvers.available_solvers.count("pinc") == 1
    x = qpsolvers.solve_qp(np.eye(2), np.array([-3.0, 1.0]), ub=np.array([2.0, 2.0]), solver="pinc")
    assert x == pytest.approx([2.0, -1.0])


def test_crossed_and_infinite_limits_have_no_solution_and_nan_is_refused() -> None:
    one, ends = np.eye(1), {"lb": [1.0], "ub": [0.0]}
    assert solve_qp(one, [1.0], **ends) is None
    assert solve_qp(np.eye(2), [1.0, 1.0], [[1.0, 1.0]], [3.0], lb=[1.0, -5.0], ub=[0.0, 5.0]) is None
    assert solve_qp(one, [1.0], lb=[np.inf], ub=[np.inf]) is None
    assert solve_qp(one, [1.0], ub=[-np.inf]) is None
    assert solve_qp(one, [1.0], G=[[1.0]], h=[-np.inf]) is None
    free = solve_qp(one, [1.0], G=[[1.0]], h=[np.inf], lb=[-np.inf])
    assert free is not None and free.x == pytest.approx([-1.0])
    for name, given in (("lb", [np.nan]), ("ub", [np.nan]), ("h", [np.nan]), ("h", None)):
        with pytest.raises(pinc.InputError, match=f"{name}: NaN"):
            solve_qp(one, [1.0], G=[[1.0]], **{"h": [1.0], name: given})
    with pytest.raises(pinc.InputError, match="q: NaN"):
        solve_qp(one, [np.nan])
    with pytest.raises(pinc.InputError, match="P: NaN"):
        solve_qp([[np.nan]], [1.0])
