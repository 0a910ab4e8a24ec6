"""The package as such."""

import ast
import inspect
import re
import textwrap
from pathlib import Path

import numpy as np
import pytest

import pinc_nmpc as pinc

FOLDER = Path(pinc.__file__).parent


def test_everything_has_a_docstring() -> None:
    for name in pinc.__all__:
        thing = getattr(pinc, name)
        if name.startswith("__"):
            continue
        assert thing.__doc__, name
        if not inspect.isclass(thing):
            continue
        for member, value in vars(thing).items():
            if not member.startswith("_"):
                assert value.__doc__, f"{name}.{member}"


def test_help_shows_what_editors_show() -> None:
    stubs = ast.parse((FOLDER / "_native.pyi").read_text(encoding="utf-8"))
    shown = 0
    for node in stubs.body:
        if not isinstance(node, (ast.ClassDef, ast.FunctionDef)) or not ast.get_docstring(node):
            continue
        thing = getattr(pinc, node.name)
        assert inspect.getdoc(thing) == ast.get_docstring(node), node.name
        for member in node.body if isinstance(node, ast.ClassDef) else []:
            if isinstance(member, ast.FunctionDef) and ast.get_docstring(member):
                found = inspect.getdoc(getattr(thing, member.name))
                assert found == ast.get_docstring(member), f"{node.name}.{member.name}"
                shown += 1
    assert shown > 100


def examples() -> list[str]:
    docs = [getattr(pinc, name).__doc__ or "" for name in pinc.__all__ if name != "__version__"]
    found = [re.search(r"Example::\n\n((?: +.*\n|\n)+)", inspect.cleandoc(doc) + "\n") for doc in docs]
    return [textwrap.dedent(example[1]) for example in found if example]


@pytest.mark.parametrize("example", examples())
def test_examples_of_docstrings_run(example: str) -> None:
    exec(example, {"pinc": pinc, "np": np})


def test_it_is_typed_and_has_a_version() -> None:
    assert (FOLDER / "py.typed").is_file() and (FOLDER / "_native.pyi").is_file()
    assert pinc.__version__.count(".") == 2


def test_errors_are_of_ordinary_kinds() -> None:
    assert issubclass(pinc.InputError, (pinc.PincError, ValueError))
    assert issubclass(pinc.RunError, (pinc.PincError, RuntimeError))
    assert not issubclass(pinc.RunError, ValueError)
