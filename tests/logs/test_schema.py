"""Laws of the message definitions: every record survives CDR, and other readers agree on what it says."""

from __future__ import annotations

import dataclasses
import struct
import zlib
from typing import Any, get_type_hints

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_samples import sample

from hippomat_core import messages as m
from hippomat_logs.records import SerialRecord
from hippomat_logs.schema import (
    EFFECTS,
    EVENTS,
    OWN,
    TOPICS,
    MessageStore,
    blank,
    definition,
    differences,
    snake,
    type_name,
)

STORE = MessageStore()
KINDS = EVENTS + EFFECTS + OWN


@settings(max_examples=300, deadline=None)
@given(kind=st.sampled_from(KINDS), seed=st.integers(0, 2**32 - 1))
def test_every_record_decodes_to_what_was_encoded(kind: type, seed: int) -> None:
    record = sample(kind, np.random.default_rng(seed))
    data = STORE.encode(record)
    again = STORE.decode(kind, data)
    assert type(again) is kind
    assert list(differences(record, again)) == []
    assert STORE.encode(again) == data


@pytest.mark.parametrize("kind", KINDS)
def test_a_decoded_record_has_the_python_types_of_its_annotations(kind: type) -> None:
    record = STORE.decode(kind, STORE.encode(blank(kind)))
    for name, hint in get_type_hints(kind).items():
        value = getattr(record, name)
        if hint in (int, float, str, bool, bytes):
            assert type(value) is hint, name


def test_every_message_class_has_a_topic_of_its_own() -> None:
    assert len(set(TOPICS.values())) == len(KINDS) == len(TOPICS)
    assert snake("PeerClaimSeen") == "peer_claim_seen"


def test_a_definition_follows_the_annotations() -> None:
    assert definition(m.PortLost) == "int64 stamp_ns\nuint8 port\nstring reason\n"
    text = STORE.schema_text(type_name(m.TasksHeard)).decode()
    assert "hippomat_msgs/TaskSlot[] slots" in text
    assert "MSG: hippomat_msgs/TaskSlot" in text


def test_an_annotation_without_a_width_is_refused_with_its_remedy() -> None:
    @dataclasses.dataclass
    class Wrong:
        number: int

    with pytest.raises(TypeError, match=r"'number'.*hippomat_core\.fields"):
        definition(Wrong)


@settings(max_examples=100, deadline=None)
@given(kind=st.sampled_from(OWN), seed=st.integers(0, 2**32 - 1))
def test_fields_without_their_checksum_are_encoded_like_the_record(kind: type, seed: int) -> None:
    record = sample(kind, np.random.default_rng(seed))
    if isinstance(record, SerialRecord):
        record = dataclasses.replace(record, crc32=zlib.crc32(record.data))
    names = [one.name for one in dataclasses.fields(record) if one.name != "crc32"]
    topic, encode = STORE.row_encoders()[kind]
    assert topic == TOPICS[kind]
    assert encode((kind, *(getattr(record, name) for name in names))) == STORE.encode(record)


def test_an_array_of_another_type_or_shape_is_refused() -> None:
    scan = blank(m.ScanReceived)
    for wrong in (np.zeros(3, np.int8), np.zeros((2, 2), np.uint8), np.zeros(3)):
        with pytest.raises(ValueError, match="stands where one of uint8 belongs"):
            STORE.encode(dataclasses.replace(scan, quality=wrong))


def test_a_record_is_encoded_alike_after_thousands_of_other_lengths() -> None:
    """Forms are kept by length, but not all of them."""
    first = SerialRecord(1, 2, 1, 1, 3, b"as ever")
    before = STORE.encode(first)
    for length in range(3000):
        data = STORE.encode(SerialRecord(1, 2, 1, 1, 3, bytes(length)))
        assert STORE.decode(SerialRecord, data).data == bytes(length)
    assert STORE.encode(first) == before


def test_an_array_with_a_step_is_recorded_like_its_copy() -> None:
    cells = np.arange(20, dtype=np.uint16)
    stepped, copied = (m.PathPlanned(1, a, a, 1.0, "new") for a in (cells[::2], cells[::2].copy()))
    assert STORE.encode(stepped) == STORE.encode(copied)


@pytest.mark.parametrize(
    ("value", "other", "path"),
    [
        (m.Drive(0.0, 0.0, "hold"), m.Drive(-0.0, 0.0, "hold"), "v_mps"),
        (m.PeerClaimSeen(1, 2, 3, "gone"), m.PeerClaimSeen(1, 2, 4, "gone"), "generation"),
    ],
)
def test_differences_name_the_field_bit_for_bit(value: Any, other: Any, path: str) -> None:
    assert [found[0] for found in differences(value, other)] == [path]


def test_a_difference_inside_an_array_of_rows_has_its_whole_path() -> None:
    rng = np.random.default_rng(4)
    while not (heard := sample(m.RelayHeard, rng)).frame.rows or not len(heard.frame.rows[0].costs):
        continue
    costs = np.array(heard.frame.rows[0].costs)
    costs[-1] ^= 1
    rows = (dataclasses.replace(heard.frame.rows[0], costs=costs), *heard.frame.rows[1:])
    other = dataclasses.replace(heard, frame=dataclasses.replace(heard.frame, rows=rows))
    assert [found[0] for found in differences(heard, other)] == [f"frame.rows[0].costs[{len(costs) - 1}]"]


@settings(max_examples=200, deadline=None)
@given(kind=st.sampled_from(KINDS), seed=st.integers(0, 2**32 - 1))
def test_our_decoder_and_rosbags_read_the_same_bytes_alike(kind: type, seed: int) -> None:
    data = STORE.encode(sample(kind, np.random.default_rng(seed)))
    assert plain(STORE.decode(kind, data)) == plain(STORE.decode_standard(data, type_name(kind)))


def plain(value: Any) -> Any:
    """A message of either side as lists and numbers."""
    if dataclasses.is_dataclass(value):
        names = [f.name for f in dataclasses.fields(value) if f.name != "__msgtype__"]
        return {name: plain(getattr(value, name)) for name in names}
    if isinstance(value, bytes | np.ndarray):
        return np.frombuffer(value, np.uint8).tolist() if isinstance(value, bytes) else value.tolist()
    return [plain(row) for row in value] if isinstance(value, list | tuple) else value


@settings(max_examples=200, deadline=None)
@given(kind=st.sampled_from(KINDS), seed=st.integers(0, 2**32 - 1), cut=st.integers(1, 10_000))
def test_a_record_cut_short_or_too_long_is_refused(kind: type, seed: int, cut: int) -> None:
    data = STORE.encode(sample(kind, np.random.default_rng(seed)))
    with pytest.raises((ValueError, struct.error)):
        STORE.decode(kind, data[: -min(cut, len(data))])
    with pytest.raises(ValueError, match="bytes were expected"):
        STORE.decode(kind, data + bytes(4))


def test_a_sweep_whose_arrays_differ_in_length_is_no_sweep() -> None:
    """Compiled loops would read beyond the shorter ones."""
    uneven = dataclasses.replace(blank(m.ScanReceived), distance_q2=np.zeros(0, np.uint16))
    with pytest.raises(ValueError, match="1 qualities, 1 angles and 0 distances"):
        STORE.decode(m.ScanReceived, STORE.encode(uneven))
