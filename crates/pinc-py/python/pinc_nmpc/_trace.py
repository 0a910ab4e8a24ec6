"""Equations from Python functions, which are called with symbols in place of numbers."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Optional, Union

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from ._errors import InputError

Variable = Union[str, Mapping[str, Any]]

# What is written for functions of NumPy, and for the operators that call them.
_FORMS = {
    "add": "({} + {})",
    "subtract": "({} - {})",
    "multiply": "({} * {})",
    "divide": "({} / {})",
    "power": "({} ^ {})",
    "negative": "(-{})",
    "positive": "{}",
    "square": "({} ^ 2)",
    "sqrt": "sqrt({})",
    "exp": "exp({})",
    "log": "log({})",
    "sin": "sin({})",
    "cos": "cos({})",
    "tan": "tan({})",
    "tanh": "tanh({})",
    "arctan": "atan({})",
    "absolute": "abs({})",
    "sign": "sign({})",
    "minimum": "min({}, {})",
    "maximum": "max({}, {})",
}


class Symbol(NDArrayOperatorsMixin):
    """A name or a number in an equation, or what a function makes of others."""

    def __init__(self, form: str, of: tuple["Symbol", ...] = ()) -> None:
        self.form, self.of = form, of

    def __array_ufunc__(self, ufunc: Any, method: str, *given: Any, **more: Any) -> Any:
        form = _FORMS.get(ufunc.__name__)
        # `a += b` is a new symbol.
        if all(isinstance(out, Symbol) for out in more.get("out", ())):
            more.pop("out", None)
        if form is None or method != "__call__" or more:
            known = ", ".join(_FORMS)
            raise InputError(
                f"np.{ufunc.__name__} given in a function that is traced, expected one of {known}, of "
                "quantities one by one; branches and comparisons are written with minimum and maximum"
            )
        if any(isinstance(one, np.ndarray) and one.ndim > 0 for one in given):
            return ufunc(*(np.asarray(one, dtype=object) for one in given))
        return Symbol(form, tuple(_symbol(one) for one in given))

    def __bool__(self) -> bool:
        raise InputError(
            "a quantity given as a condition in a function that is traced, expected none: `if`, `and`, "
            "`or` and `not` see no values; branches are written with minimum and maximum"
        )

    def __float__(self) -> float:
        raise InputError(
            "a quantity given as a number in a function that is traced: arrays that hold quantities are "
            "lists, or made with dtype=object"
        )

    def __getattr__(self, name: str) -> Any:
        """The method that NumPy looks for in arrays of symbols."""
        form = _FORMS.get(name, "")
        if form.count("{}") != 1:
            raise AttributeError(name)
        return lambda: Symbol(form, (self,))


def _symbol(given: Any) -> Symbol:
    if isinstance(given, Symbol):
        return given
    text = repr(float(given))
    return Symbol(f"({text})" if text.startswith("-") else text)


def expression(
    derivatives: Callable[..., Iterable[Any]],
    states: Sequence[Variable],
    inputs: Sequence[Variable],
    parameters: Optional[Mapping[str, float]] = None,
    outputs: Optional[Callable[..., Mapping[str, Any]]] = None,
) -> dict[str, Any]:
    """Writes a Python function down as an equation: the table ``plant.expression`` of a config.

    ``derivatives(x, u)`` returns the time derivatives of the states, per s. ``x`` and ``u`` are
    arrays of symbols in the order of ``states`` and ``inputs``, names or dictionaries with ``name`` and
    ``unit``. With ``parameters``, values by their names, functions take a dictionary of symbols as
    third argument. ``outputs`` takes the same and returns outputs by their names. Operators, products of
    arrays, and ``np.sqrt`` and others that equations have can be used; ``if`` cannot.

    Example::

        def tank(x, u, p):
            return [(u[0] - p["k"] * np.sqrt(np.maximum(x[0], 0.0))) / p["a"]]

        table = pinc.expression(tank, ["h"], ["q"], {"k": 0.5, "a": 2.0})
        plant = pinc.Plant({"name": "tank", "preset": "ours", "seed": 1, "plant": {"expression": table}})
    """
    names = [[v if isinstance(v, str) else v["name"] for v in of] for of in (states, inputs)]
    given: list[Any] = [np.array([*map(Symbol, of), None], dtype=object)[:-1] for of in names]
    if parameters is not None:
        given.append({name: Symbol(name) for name in parameters})
    found = derivatives(*given)
    if isinstance(found, Mapping) or not isinstance(found, Iterable):
        raise InputError(f"derivatives: {type(found).__name__} given, expected a list, one per state")
    rates = [_symbol(one) for one in found]
    if len(rates) != len(names[0]):
        raise InputError(
            f"derivatives: {len(rates)} given, expected {len(names[0])}, one per state: "
            + ", ".join(names[0])
        )
    more = {} if outputs is None else {k: _symbol(v) for k, v in outputs(*given).items()}
    let, written = _written([*rates, *more.values()], {*names[0], *names[1], *(parameters or {}), *more})
    return {
        "states": list(states),
        "inputs": list(inputs),
        "parameters": dict(parameters or {}),
        "let": let,
        "derivatives": dict(zip(names[0], written)),
        "outputs": dict(zip(more, written[len(rates) :])),
    }


def _written(roots: list[Symbol], taken: set[str]) -> tuple[dict[str, str], list[str]]:
    """The texts of symbols. What occurs in several places gets a name."""
    order: list[Symbol] = []
    uses = Counter(map(id, roots))
    seen: set[int] = set()
    stack = [(root, False) for root in reversed(roots)]
    while stack:
        symbol, done = stack.pop()
        if done:
            order.append(symbol)
        elif id(symbol) not in seen:
            seen.add(id(symbol))
            uses.update(map(id, symbol.of))
            stack += [(symbol, True), *((part, False) for part in reversed(symbol.of))]
    free = (name for k in range(1, len(order) + len(taken) + 1) if (name := f"w{k}") not in taken)
    let: dict[str, str] = {}
    texts: dict[int, str] = {}
    for symbol in order:
        text = symbol.form.format(*(texts[id(part)] for part in symbol.of))
        if symbol.of and uses[id(symbol)] > 1:
            name = next(free)
            let[name], text = text, name
        texts[id(symbol)] = text
    return let, [texts[id(root)] for root in roots]
