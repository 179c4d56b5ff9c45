"""Settings as a tree of frozen dataclasses, read from TOML text: numbers have ranges, words have choices.

An unknown key, another type or a value outside its range is refused by name. Knows text, not files.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from dataclasses import field
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from hippomat_core.errors import ConfigError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

T = TypeVar("T")


def number(default: float, low: float, high: float) -> Any:
    """A field between low and high."""
    return field(default=default, metadata={"low": low, "high": high})


def choice(default: str, *options: str) -> Any:
    """A field that is one of the options."""
    return field(default=default, metadata={"options": options})


def parse_toml(text: str, name: str) -> dict[str, Any]:
    """The tree of TOML text; ConfigError names `name`."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{name}: not valid TOML: {error}") from None


def read_table(kind: type[T], values: Any, where: str) -> T:
    """A dataclass of nested dictionaries; lists become tuples. where: what errors begin with."""
    if not isinstance(values, Mapping):
        raise ConfigError(f"{where} must be a table, found {values!r}")
    hints = get_type_hints(kind)
    known = {f.name: f for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    read: dict[str, Any] = {}
    for key, value in values.items():
        if key not in known:
            raise ConfigError(f"{where} unknown key {key!r}; known: {', '.join(known)}")
        read[key] = _read(value, hints[key], known[key].metadata, where, key)
    return kind(**read)


def _read(value: Any, kind: Any, limits: Mapping[str, Any], where: str, key: str) -> Any:
    if dataclasses.is_dataclass(kind):
        return read_table(kind, value, f"{where} [{key}]")  # type: ignore[arg-type]
    if get_origin(kind) is tuple:
        if not isinstance(value, (list, tuple)):
            raise ConfigError(f"{where} {key} = {value!r} must be a list")
        return tuple(_read(item, get_args(kind)[0], limits, where, key) for item in value)
    if get_origin(kind) is dict:
        return _read_dict(value, get_args(kind)[1], limits, f"{where} [{key}]")
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not kind:
        raise ConfigError(f"{where} {key} = {value!r} must be of type {kind.__name__}")
    if "low" in limits and not limits["low"] <= value <= limits["high"]:
        raise ConfigError(f"{where} {key} = {value!r} is outside {limits['low']} .. {limits['high']}")
    if "options" in limits and value not in limits["options"]:
        raise ConfigError(f"{where} {key} = {value!r} is not one of {', '.join(limits['options'])}")
    return value


def _read_dict(values: Any, kind: Any, limits: Mapping[str, Any], where: str) -> dict[str, Any]:
    if not isinstance(values, Mapping):
        raise ConfigError(f"{where} must be a table, found {values!r}")
    if kind is Any:
        return dict(values)
    return {key: _read(value, kind, limits, where, key) for key, value in values.items()}
