"""The package as such."""

import inspect
from pathlib import Path

import pinc_nmpc as pinc


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


def test_it_is_typed_and_has_a_version() -> None:
    folder = Path(pinc.__file__).parent
    assert (folder / "py.typed").is_file() and (folder / "_native.pyi").is_file()
    assert pinc.__version__.count(".") == 2


def test_errors_are_of_ordinary_kinds() -> None:
    assert issubclass(pinc.InputError, (pinc.PincError, ValueError))
    assert issubclass(pinc.RunError, (pinc.PincError, RuntimeError))
    assert not issubclass(pinc.RunError, ValueError)
