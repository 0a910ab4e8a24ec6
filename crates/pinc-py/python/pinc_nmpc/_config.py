"""From what a caller gives for a config to what the libraries take."""

import json
import os
from collections.abc import Mapping
from typing import Any, Optional, Union

from ._errors import InputError

Config = Union[str, "os.PathLike[str]", Mapping[str, Any]]


def resolve(
    config: Config, overrides: Optional[Mapping[str, object]]
) -> tuple[str, Optional[str], list[str]]:
    """Path and text of a config (no text: it is to be read), and its overrides as ``key=value``.

    A mapping has the keys and tables of a config. The value ``None`` takes a key away.
    """
    sets = [
        f"--unset {key}" if value is None else f"{key}={_toml(key, value)}"
        for key, value in (overrides or {}).items()
    ]
    if isinstance(config, Mapping):
        text = "".join(f"{json.dumps(key)} = {_toml(key, value)}\n" for key, value in config.items())
        return "<config>", text, sets
    if isinstance(config, str) and "\n" in config:
        return "<config>", config, sets
    return os.fspath(config), None, sets


def _toml(key: str, value: Any) -> str:
    """A value as TOML."""
    # Of NumPy: numbers and arrays.
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, str):
        # A basic string of TOML has the escapes of JSON, but for DEL.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, os.PathLike):
        return _toml(key, os.fspath(value))
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml(key, item) for item in value) + "]"
    if isinstance(value, Mapping):
        items = (f"{json.dumps(str(name))} = {_toml(key, item)}" for name, item in value.items())
        return "{ " + ", ".join(items) + " }"
    expected = "a number, a text, a list or a dict"
    raise InputError(f"{key}: {value!r} given, expected {expected}")
