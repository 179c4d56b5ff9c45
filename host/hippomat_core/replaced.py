"""dataclasses.replace() for the core's frozen values, four times as fast: a step makes dozens of new ones.

For each class a function is generated once that copies slot by slot; __init__ is not run, so classes that do
more there than to take their fields in go through dataclasses.replace() itself. Type checkers see that one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

T = TypeVar("T")
_Copier = Callable[[Any, dict[str, Any]], Any]

if TYPE_CHECKING:
    from dataclasses import replace as replace
else:

    def replace(value: T, /, **changes: Any) -> T:
        """`value` with other values in some of its fields."""
        kind = type(value)
        copy = _COPIERS.get(kind)
        if copy is None:
            copy = _COPIERS[kind] = _copier(kind)
        return copy(value, changes)


_COPIERS: dict[type, _Copier] = {}


def maker_of(kind: type) -> Callable[..., Any]:
    """What makes a `kind` of all its fields, in their order, faster than the __init__ of a frozen class."""
    setters = _setters(kind)
    if setters is None:
        return kind
    sets = "".join(f" s{k}(made, v{k})\n" for k in range(len(setters)))  # a field may have any name
    code = (
        f"def make({', '.join(f'v{k}' for k in range(len(setters)))}):\n made = new(kind)\n{sets} return made"
    )
    names: dict[str, Any] = {"new": object.__new__, "kind": kind}
    names.update((f"s{k}", setter) for k, setter in enumerate(setters.values()))
    exec(compile(code, "<maker>", "exec"), names)
    return names["make"]  # type: ignore[no-any-return]


def _setters(kind: type) -> dict[str, Callable[[Any, Any], None]] | None:
    """By field, what writes its slot; None where __init__ does more than that."""
    fields = dataclasses.fields(kind)
    slots = set(kind.__dict__.get("__slots__", ()))
    if hasattr(kind, "__post_init__") or any(not f.init or f.name not in slots for f in fields):
        return None
    return {f.name: kind.__dict__[f.name].__set__ for f in fields}


def _copier(kind: type) -> _Copier:
    setters = _setters(kind)
    if setters is None:
        return lambda value, changes: dataclasses.replace(value, **changes)
    copied = "".join(f" set_{name}(made, value.{name})\n" for name in setters)
    code = f"def copy(value, changes):\n made = new(kind)\n{copied}"
    code += " for name in changes: setters[name](made, changes[name])\n return made"
    names: dict[str, Any] = {"new": object.__new__, "kind": kind, "setters": setters}
    names.update((f"set_{name}", setter) for name, setter in setters.items())
    exec(compile(code, "<copier>", "exec"), names)
    return names["copy"]  # type: ignore[no-any-return]
