"""The queue between control loop and writer: what goes in comes out, or is named in its place."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from hippomat_core import messages as m
from hippomat_logs.record_queue import LeftOut, RecordQueue, may_go

LIMIT = 12
PUTS = st.sampled_from(["tick", "lidar", "base"])
TAKES = st.integers(1, LIMIT)


def put(queue: RecordQueue, stamp_ns: int, what: str) -> None:
    if what == "tick":
        queue.put(stamp_ns, m.Tick(stamp_ns))
    else:
        queue.serial(stamp_ns, m.LIDAR if what == "lidar" else m.BASE, 0, 1, b"moved")


@given(st.lists(PUTS | TAKES, max_size=120))
def test_every_record_comes_out_in_order_or_is_named_in_its_place(actions: list[str | int]) -> None:
    queue, taken, puts = RecordQueue(LIMIT), [], 0
    for action in actions:
        if isinstance(action, str):
            put(queue, puts, action)
            puts += 1
            assert len(queue.entries) <= LIMIT + 1  # one LeftOut beyond the records
            assert queue.numbered == puts
        else:
            taken += [queue.entries.popleft() for _ in range(min(action, len(queue.entries)))]
    queue.end()
    assert queue.left() == sum(type(record) is not LeftOut for _, record in queue.entries)
    number = left_out = 0
    for stamp_ns, record in [*taken, *queue.entries]:
        count = record.count if type(record) is LeftOut else 1
        left_out += count if type(record) is LeftOut else 0
        number += count
        assert stamp_ns == number - 1  # stamps count the puts
    assert number == puts
    assert left_out == queue.dropped + queue.shed
    assert queue.drop_cause == ""


@given(st.lists(PUTS, min_size=LIMIT // 2, max_size=LIMIT))
def test_below_its_limit_a_queue_leaves_out_bulk_alone(kinds: list[str]) -> None:
    queue = RecordQueue(LIMIT)
    for stamp_ns, what in enumerate(kinds):
        put(queue, stamp_ns, what)
    queue.end()
    kept = {stamp_ns for stamp_ns, record in queue.entries if type(record) is not LeftOut}
    assert kept >= {k for k, what in enumerate(kinds) if what != "lidar" or k < LIMIT // 2}
    assert queue.dropped == 0


def test_a_record_of_its_class_and_fields_is_bulk_where_the_lidar_sent_it() -> None:
    queue = RecordQueue(LIMIT)
    for port in (m.RADIO, m.BASE, m.LIDAR):
        queue.serial(0, port, 0, 1, b"moved")
    assert [may_go(record) for _, record in queue.entries] == [False, False, True]
