"""A model as a function of CasADi, and as a model of do-mpc."""

import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._native import Model


def function(model: "Model", name: str) -> Any:
    """The net in SX: derivatives of any order, code generation and all solvers take it."""
    try:
        import casadi
    except ImportError as error:
        raise ImportError("Model.casadi needs the package casadi: pip install casadi") from error
    x = casadi.SX.sym("x", len(model.states))
    u = casadi.SX.sym("u", len(model.inputs))
    p = casadi.SX.sym("p", len(model.parameters))
    value = casadi.vertcat(x, u, p)
    layers = model.layers
    for number, (weights, bias) in enumerate(layers, 1):
        value = casadi.DM(weights) @ value + casadi.DM(bias)
        if number < len(layers):
            value = casadi.tanh(value)
    if model.adds_initial_state:
        value = x + value
    arguments, names = [x, u], ["x", "u"]
    if model.parameters:
        arguments, names = [x, u, p], ["x", "u", "p"]
    return casadi.Function(name, arguments, [value], names, ["x_next"])


def do_mpc(model: "Model") -> Any:
    """The net as a discrete model of do-mpc, set up."""
    try:
        from do_mpc.model import Model as DoMpc
    except ImportError as error:
        raise ImportError("Model.do_mpc needs the package do-mpc: pip install do-mpc") from error
    import casadi

    made = DoMpc("discrete", "SX")
    # Of arrays, without brackets.
    kinds = {"_x": model.states, "_u": model.inputs, "_p": model.parameters}
    plain = {kind: [re.sub(r"\W+", "_", name).strip("_") for name in of] for kind, of in kinds.items()}
    given = [[made.set_variable(kind, name) for name in names] for kind, names in plain.items()]
    vectors = [casadi.vertcat(*of) for of in given if of]
    x_next = function(model, "net")(*vectors)
    for place, name in enumerate(plain["_x"]):
        made.set_rhs(name, x_next[place])
    made.setup()
    return made
