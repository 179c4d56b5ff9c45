"""Frozen values made fast: a step makes dozens of them. replace() is dataclasses.replace().

A frozen class forbids `made.x = ...`, and the way around it costs ten times as much. So a value is filled
while it is of a twin class, which has the same slots and is not frozen, and then becomes one of its own.
Functions that do so are generated once for each class. Classes that do more at their making than to take
their fields in are left to dataclasses. Type checkers see dataclasses everywhere.
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
_OUR_CODE = "<value>"  # the file of functions generated here, in a traceback
_DATACLASS_CODE = dataclasses.make_dataclass("_Any", []).__init__.__code__.co_filename  # type: ignore[misc]


def quickly_made(kind: type[T]) -> type[T]:
    """Decorates a frozen dataclass with slots of which thousands are made: __init__ becomes a fast one."""
    twin = _twin(kind)
    fields = dataclasses.fields(kind)  # type: ignore[arg-type]
    special = any(f.default_factory is not dataclasses.MISSING or f.kw_only for f in fields)
    if twin is None or special:
        raise TypeError(f"{kind.__name__} cannot be made quickly: it takes plain fields in, and does no more")
    body = "".join(f" self.{f.name} = {f.name}\n" for f in fields)
    init = _generated(
        f"def __init__(self, {', '.join([f.name for f in fields])}):\n"
        f" _become(self, _twin)\n{body} self.__class__ = _kind\n",
        _become=object.__dict__["__class__"].__set__,
        _twin=twin,
        _kind=kind,
    )
    init.__defaults__ = kind.__init__.__defaults__
    init.__annotations__ = kind.__init__.__annotations__
    init.__qualname__ = f"{kind.__qualname__}.__init__"
    kind.__init__ = init  # type: ignore[method-assign]
    kind.__init_subclass__ = classmethod(_refuse_subclass)  # type: ignore[assignment]
    return kind


def _refuse_subclass(kind: type) -> None:
    """A subclass would inherit the fast __init__, which makes its base: dataclasses would not."""
    base = kind.__bases__[0].__name__
    raise TypeError(f"{kind.__name__} cannot inherit from {base}, which is quickly made: it would become one")


def maker_of(kind: type) -> Callable[..., Any]:
    """What makes a `kind` of all its fields, in their order, faster still: without keywords and defaults."""
    twin = _twin(kind)
    if twin is None:
        return kind
    names = [f.name for f in dataclasses.fields(kind)]  # of any spelling, so none is a parameter's
    body = "".join(f" made.{name} = v{k}\n" for k, name in enumerate(names))
    make: Callable[..., Any] = _generated(
        f"def make({', '.join([f'v{k}' for k in range(len(names))])}):\n"
        f" made = twin()\n{body} made.__class__ = kind\n return made",
        twin=twin,
        kind=kind,
    )
    return make


def _copier(kind: type) -> _Copier:
    twin = _twin(kind)
    if twin is None:
        return lambda value, changes: dataclasses.replace(value, **changes)
    body = "".join(f" made.{f.name} = value.{f.name}\n" for f in dataclasses.fields(kind))
    copy: _Copier = _generated(
        f"def copy(value, changes):\n made = twin()\n{body}"
        " try:\n  for name in changes: setattr(made, name, changes[name])\n"
        " except AttributeError: return careful(value, **changes)\n"  # says what dataclasses says
        " made.__class__ = kind\n return made",
        twin=twin,
        kind=kind,
        setattr=setattr,
        careful=dataclasses.replace,
    )
    return copy


def _twin(kind: type) -> type | None:
    """The class with the same slots that is not frozen; None where making a `kind` takes more than that."""
    fields = dataclasses.fields(kind)
    slots = kind.__dict__.get("__slots__", ())
    plain = kind.__bases__ == (object,) and not hasattr(kind, "__post_init__") and _has_made_init(kind)
    if not plain or any(not f.init for f in fields) or set(slots) != {f.name for f in fields}:
        return None
    return type(kind.__name__, (), {"__slots__": slots})


def _has_made_init(kind: type) -> bool:
    """Did dataclasses (or quickly_made) write its __init__? They leave one alone that the class defines."""
    code = getattr(kind.__init__, "__code__", None)  # type: ignore[misc]
    return code is not None and code.co_filename in (_DATACLASS_CODE, _OUR_CODE)


def _generated(code: str, **names: Any) -> Any:
    """The one function that the code defines."""
    scope: dict[str, Any] = {}
    exec(compile(code, _OUR_CODE, "exec"), names, scope)
    (function,) = scope.values()
    return function
