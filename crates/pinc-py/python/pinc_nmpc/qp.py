"""Quadratic programs by the dense dual active-set method of the controllers.

It is made for the small, strictly convex programs of model predictive control; Clarabel solves those on
which it fails. ``register`` adds it to the package qpsolvers under the name ``"pinc"``.
"""

from typing import Any, NamedTuple, Optional

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._native import solve_dense_qp

_Array = NDArray[np.float64]


class QpSolution(NamedTuple):
    """The solution of a program with its multipliers."""

    x: _Array
    """The solution."""
    z: _Array
    """The multipliers of ``G x <= h``, 0 or more."""
    y: _Array
    """The multipliers of ``A x = b``."""
    z_box: _Array
    """The multipliers of the bounds, negative at lower ones."""


def _dense(matrix: Any) -> Any:
    return matrix.toarray() if hasattr(matrix, "toarray") else matrix


def solve_qp(
    P: Any,
    q: ArrayLike,
    G: Any = None,
    h: Optional[ArrayLike] = None,
    A: Any = None,
    b: Optional[ArrayLike] = None,
    lb: Optional[ArrayLike] = None,
    ub: Optional[ArrayLike] = None,
) -> Optional[QpSolution]:
    """Minimizes ``x'P x / 2 + q'x`` subject to ``G x <= h``, ``A x = b`` and ``lb <= x <= ub``.

    ``P`` is symmetric and positive semidefinite. Returns None where there is no solution, or none was
    found. Matrices are NumPy arrays or sparse ones of SciPy, which are filled.
    """
    matrices = [_dense(matrix) for matrix in (P, G, A)]
    found = solve_dense_qp(matrices[0], q, matrices[1], h, matrices[2], b, lb, ub)
    return None if found is None else QpSolution(*found)


def register() -> None:
    """Adds the solver ``"pinc"`` to qpsolvers, for ``qpsolvers.solve_qp(.., solver="pinc")``."""
    import qpsolvers
    from qpsolvers.solvers import dense_solvers, solve_function

    def solve_problem(problem: Any, initvals: Any = None, verbose: bool = False, **_: Any) -> Any:
        found = solve_qp(*problem.unpack())
        solution = qpsolvers.Solution(problem)
        solution.found = found is not None
        if found is not None:
            solution.x, solution.z, solution.y, solution.z_box = found
            solution.obj = float(found.x @ (problem.P @ found.x) / 2 + problem.q @ found.x)
        return solution

    for names in (dense_solvers, qpsolvers.available_solvers):
        if "pinc" not in names:
            names.append("pinc")
    solve_function["pinc"] = solve_problem
