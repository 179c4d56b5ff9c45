"""The core's values made fast are what dataclasses would have made."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hippomat_core.replaced import maker_of, quickly_made, replace


@dataclass(frozen=True, slots=True)
class Plain:
    a: int
    b: str = "b"
    c: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Checked:
    a: int

    def __post_init__(self) -> None:
        if self.a < 0:
            raise ValueError("a < 0")


@dataclass(frozen=True)
class WithoutSlots:
    a: int = 1
    b: int = 2


@dataclass(frozen=True, slots=True)
class Derived:
    a: int
    twice: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "twice", 2 * self.a)


CHANGES = st.fixed_dictionaries(
    {}, optional={"a": st.integers(), "b": st.text(), "c": st.tuples(st.integers())}
)


@given(changes=CHANGES)
def test_it_makes_what_dataclasses_makes_and_leaves_the_old_one(changes: dict[str, object]) -> None:
    old = Plain(1, "x", (3,))
    assert replace(old, **changes) == dataclasses.replace(old, **changes)  # type: ignore[arg-type]
    assert old == Plain(1, "x", (3,))


def test_a_class_that_checks_or_computes_at_its_making_still_does() -> None:
    with pytest.raises(ValueError, match="a < 0"):
        replace(Checked(1), a=-1)
    assert replace(Derived(1), a=4).twice == 8


def test_a_class_without_slots_and_an_unknown_field() -> None:
    assert replace(WithoutSlots(), b=5) == WithoutSlots(1, 5)
    for known in (Plain(1), WithoutSlots()):
        with pytest.raises(TypeError, match="unexpected keyword argument 'd'"):
            replace(known, d=1)  # type: ignore[call-arg]


@dataclass(frozen=True, slots=True)
class NamedLikeCode:
    kind: int
    made: str
    new: float


def test_a_maker_makes_what_the_class_makes_whatever_its_fields_are_called() -> None:
    assert maker_of(NamedLikeCode)(1, "x", 2.0) == NamedLikeCode(1, "x", 2.0)
    assert maker_of(Plain)(1, "x", (3,)) == Plain(1, "x", (3,))
    with pytest.raises(ValueError, match="a < 0"):
        maker_of(Checked)(-1)


@dataclass(frozen=True, slots=True)
class WithOwnInit:
    a: int

    def __init__(self, a: int) -> None:
        object.__setattr__(self, "a", a + 1)


@quickly_made
@dataclass(frozen=True, slots=True)
class Quick:
    kind: int
    twin: str = "b"
    copy: tuple[int, ...] = field(default=(), compare=False)


@given(kind=st.integers(), rest=st.fixed_dictionaries({}, optional={"twin": st.text(), "copy": st.tuples()}))
def test_what_is_quickly_made_is_what_its_dataclass_would_be(kind: int, rest: dict[str, object]) -> None:
    made = Quick(kind, **rest)  # type: ignore[arg-type]
    assert type(made) is Quick
    assert dataclasses.astuple(made) == (kind, rest.get("twin", "b"), rest.get("copy", ()))
    assert made == Quick(kind, made.twin, (1,))
    assert hash(made) == hash(replace(made, copy=(2,)))
    assert pickle.loads(pickle.dumps(made)) == copy.deepcopy(made) == made


def test_values_stay_frozen_however_they_were_made() -> None:
    for made in (Quick(1), replace(Quick(1), kind=2), maker_of(Quick)(1, "b", ())):
        with pytest.raises(dataclasses.FrozenInstanceError):
            made.kind = 3  # type: ignore[misc]


def test_a_class_that_does_more_than_take_its_fields_in_cannot_be_quickly_made() -> None:
    for kind in (Checked, WithoutSlots, Derived, WithOwnInit):
        with pytest.raises(TypeError, match=f"{kind.__name__} cannot be made quickly"):
            quickly_made(kind)


def test_a_class_that_writes_its_own_init_is_copied_and_made_through_it() -> None:
    assert replace(WithOwnInit(1), a=4).a == dataclasses.replace(WithOwnInit(1), a=4).a == 5
    assert maker_of(WithOwnInit)(1).a == 2


def test_what_is_quickly_made_has_no_subclasses_that_would_become_their_base() -> None:
    with pytest.raises(TypeError, match="Finer cannot inherit from Quick, which is quickly made"):
        type("Finer", (Quick,), {"__slots__": ()})
