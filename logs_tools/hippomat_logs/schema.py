"""ROS 2 message definitions of everything we record, derived from the annotations of its dataclasses.

Decides names, field types and CDR bytes. Knows nothing of files. Our records go through generated code of our
own (cdr_encoder.py, cdr_decoder.py), standard ROS messages through rosbags'.
"""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Iterator
from typing import Any, cast, get_args, get_origin, get_type_hints

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hippomat_core import messages
from hippomat_logs.cdr_decoder import Decoder, make_decoder
from hippomat_logs.cdr_encoder import Encoder, FieldSpec, make_encoder, make_row_encoder
from hippomat_logs.cdr_layout import Field, fields_of_type
from hippomat_logs.records import DropRecord, ProcessRecord, SerialRecord, TimingRecord

PACKAGE = "hippomat_msgs"
EVENTS: tuple[type, ...] = get_args(messages.Event)
EFFECTS: tuple[type, ...] = get_args(messages.Effect)
OWN: tuple[type, ...] = (SerialRecord, TimingRecord, DropRecord, ProcessRecord)


def snake(name: str) -> str:
    """BaseFeedback -> base_feedback."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


TOPICS: dict[type, str] = {
    **{kind: f"/hippo/event/{snake(kind.__name__)}" for kind in EVENTS},
    **{kind: f"/hippo/effect/{snake(kind.__name__)}" for kind in EFFECTS},
    SerialRecord: "/hippo/serial",
    TimingRecord: "/hippo/timing",
    DropRecord: "/hippo/dropped",
    ProcessRecord: "/hippo/process",
}
CLASSES: dict[str, type] = {topic: kind for kind, topic in TOPICS.items()}
EVENT_TOPICS = frozenset(TOPICS[kind] for kind in EVENTS)
EFFECT_TOPICS = frozenset(TOPICS[kind] for kind in EFFECTS)

DERIVED: dict[str, str] = {
    "/scan": "sensor_msgs/msg/LaserScan",
    "/odom": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/plan": "nav_msgs/msg/Path",
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/rosout": "rcl_interfaces/msg/Log",
}
LATCHED = {"/map", "/tf_static"}


def type_name(kind: type) -> str:
    return f"{PACKAGE}/msg/{kind.__name__}"


@dataclasses.dataclass(frozen=True)
class _Field:
    name: str
    ros: str  # type in the message definition
    python: type | None  # element class of a nested message
    many: bool


def _field(name: str, hint: Any) -> _Field:
    if hint is str:
        return _Field(name, "string", None, False)
    if hint is bool:
        return _Field(name, "bool", None, False)
    if hint is bytes:
        return _Field(name, "uint8[]", bytes, True)
    if hasattr(hint, "__metadata__"):
        return _Field(name, str(hint.__metadata__[0]), None, str(hint.__metadata__[0]).endswith("[]"))
    if get_origin(hint) is tuple:
        row, rest = get_args(hint)
        if rest is Ellipsis and dataclasses.is_dataclass(row):
            return _nested(name, cast(type, row), many=True)
    if dataclasses.is_dataclass(hint):
        return _nested(name, cast(type, hint), many=False)
    raise TypeError(
        f"field {name!r} has annotation {hint!r}: use a name of hippomat_core.fields, str, bool or bytes"
    )


def _nested(name: str, kind: type, many: bool) -> _Field:
    return _Field(name, f"{PACKAGE}/{kind.__name__}" + "[]" * many, kind, many)


def fields_of(kind: type) -> tuple[_Field, ...]:
    hints = get_type_hints(kind, include_extras=True)
    return tuple(_field(f.name, hints[f.name]) for f in dataclasses.fields(kind))


def definition(kind: type) -> str:
    """Body of the .msg file of one dataclass."""
    return "".join(f"{field.ros} {field.name}\n" for field in fields_of(kind))


def nested(kind: type) -> Iterator[type]:
    """Message classes inside `kind`, innermost first, without `kind`."""
    for field in fields_of(kind):
        if field.python is not None and field.python is not bytes:
            yield from nested(field.python)
            yield field.python


class MessageStore:
    """Encodes and decodes every record; slow to build (compiles code), so build one and keep it."""

    def __init__(self) -> None:
        self._types = get_typestore(Stores.ROS2_JAZZY)
        kinds: dict[type, None] = {}
        for kind in TOPICS:
            kinds.update(dict.fromkeys(nested(kind)))
            kinds[kind] = None
        definitions: dict[str, Any] = {}
        for kind in kinds:
            definitions.update(get_types_from_msg(definition(kind), type_name(kind)))
        self._types.register(definitions)
        self._encoders = {kind: make_encoder(_specs(kind)) for kind in TOPICS}
        self._decoders = {kind: make_decoder(kind, _specs(kind)) for kind in TOPICS}
        self._decoders[messages.ScanReceived] = _whole_scans(self._decoders[messages.ScanReceived])

    def encode(self, message: object) -> bytes:
        """CDR bytes of one of our records; raises ValueError or struct.error where a value does not fit."""
        return self._encoders[type(message)](message)

    def encoders(self) -> dict[type, tuple[str, Encoder]]:
        """Topic and encoder of every class, for whoever encodes hundreds a second."""
        return {kind: (TOPICS[kind], encoder) for kind, encoder in self._encoders.items()}

    def row_encoders(self) -> dict[type, tuple[str, Encoder]]:
        """The same for (class, its fields ...) instead of a message, of the log's own records, without their
        checksum."""
        return {kind: (TOPICS[kind], make_row_encoder(_specs(kind))) for kind in OWN}

    def decode(self, kind: type, data: bytes | memoryview) -> Any:
        """The record again, its arrays read-only; struct.error or ValueError where the bytes hold none."""
        return self._decoders[kind](data)

    def encode_standard(self, message: object, name: str) -> bytes:
        return bytes(self._types.serialize_cdr(message, name))

    def decode_standard(self, data: bytes | memoryview, name: str) -> Any:
        return self._types.deserialize_cdr(data, name)

    def standard(self, name: str) -> Any:
        """Class of a standard ROS message, e.g. sensor_msgs/msg/LaserScan."""
        return self._types.types[name]

    def fields(self, name: str) -> tuple[Field, ...]:
        """The fields of a message by its ROS name."""
        return fields_of_type(self._types.fielddefs, name)

    def schema_text(self, name: str) -> bytes:
        """Concatenated ros2msg definition for a reader that knows only the file."""
        text, _ = self._types.generate_msgdef(name, ros_version=2)
        return text.encode()

    def type_hash(self, name: str) -> str:
        return self._types.hash_rihs01(name)

    def warm_up(self) -> None:
        """Encode and decode one of everything: the first use of each type compiles for 6 to 21 ms."""
        for kind in TOPICS:
            self.decode(kind, self.encode(blank(kind)))


def _whole_scans(decode: Decoder) -> Decoder:
    """Compiled loops over a sweep look at no bounds, so that its arrays must have one length."""

    def decode_whole(data: bytes | memoryview) -> Any:
        scan = decode(data)
        lengths = len(scan.quality), len(scan.angle_q6), len(scan.distance_q2)
        if len(set(lengths)) > 1:
            raise ValueError("a sweep of {} qualities, {} angles and {} distances".format(*lengths))
        return scan

    return decode_whole


def _specs(kind: type) -> tuple[FieldSpec, ...]:
    """The fields of a class as encoder and decoder want them."""
    return tuple(
        FieldSpec(f.name, f.ros, False, _specs(f.python), f.many, f.python)
        if f.python not in (None, bytes)
        else FieldSpec(f.name, f.ros, f.python is bytes, (), f.many)
        for f in fields_of(kind)
    )


def blank(kind: type) -> Any:
    """A record of `kind` with zeros and empty strings; arrays of rows hold one row."""
    values: list[Any] = []
    for field in fields_of(kind):
        if field.python is bytes:
            values.append(b"\0")
        elif field.python is not None:
            values.append((blank(field.python),) if field.many else blank(field.python))
        elif field.many:
            values.append(np.zeros(1, dtype=field.ros[:-2]))
        else:
            values.append({"string": "", "bool": False, "float64": 0.0}.get(field.ros, 0))
    return kind(*values)


def differences(ours: Any, theirs: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """(field path, value, other value) wherever two records of one class are not bit-equal."""
    if type(ours) is not type(theirs) and dataclasses.is_dataclass(ours):
        yield path or "type", type(ours).__name__, type(theirs).__name__
    elif dataclasses.is_dataclass(ours) and not isinstance(ours, type):
        for f in dataclasses.fields(ours):
            inner = f"{path}.{f.name}" if path else f.name
            yield from differences(getattr(ours, f.name), getattr(theirs, f.name), inner)
    elif isinstance(ours, tuple) or isinstance(theirs, tuple):
        if len(ours) != len(theirs):
            yield f"len({path})", len(ours), len(theirs)
        for k, (a, b) in enumerate(zip(ours, theirs, strict=False)):
            yield from differences(a, b, f"{path}[{k}]")
    elif isinstance(ours, np.ndarray):
        yield from _array_differences(ours, np.asarray(theirs), path)
    elif _bits(ours) != _bits(theirs):
        yield path, ours, theirs


def _array_differences(ours: Any, theirs: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    if len(ours) != len(theirs):
        yield f"len({path})", len(ours), len(theirs)
    n = min(len(ours), len(theirs))
    a, b = np.ascontiguousarray(ours[:n]), np.ascontiguousarray(theirs[:n], dtype=ours.dtype)
    width = a.dtype.itemsize
    unequal = (a.view(np.uint8).reshape(n, width) != b.view(np.uint8).reshape(n, width)).any(axis=1)
    for k in np.nonzero(unequal)[0]:
        yield f"{path}[{k}]", a[k].item(), b[k].item()


def _bits(value: Any) -> Any:
    if isinstance(value, (float, np.floating)):
        return np.float64(value).tobytes()
    return value


assert sys.byteorder == "little", "the log format is little-endian; so must be the machine that writes it"
