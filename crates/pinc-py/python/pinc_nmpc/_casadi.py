"""A model as a function of CasADi."""

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
