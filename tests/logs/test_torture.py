"""Logs survive what happens to robots: cut files, flipped bits, killed processes, pulled plugs.

Few cases of each here; `make torture` tries a thousand.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from torture_lab import (
    Victim,
    flipped,
    full_disk,
    make_victim,
    seconds_lost_by_kill,
    seconds_lost_by_power_cut,
    strict_reader_notices,
    table_reader_is_right,
    truncated,
    whole_file,
)


@pytest.fixture(scope="module")
def victim(tmp_path_factory: pytest.TempPathFactory) -> Victim:
    made = make_victim(tmp_path_factory.mktemp("victim"), chunks=4)
    assert len(made.chunks) >= 4
    return made


def test_a_file_cut_anywhere_loses_no_whole_chunk_and_invents_nothing(victim: Victim, tmp_path: Path) -> None:
    for cut in np.random.default_rng(1).integers(0, len(victim.data), 40):
        outcome = truncated(victim, int(cut), tmp_path)
        assert (outcome.lost_whole, outcome.invented) == (0, 0), f"cut at {cut}"


def test_a_flipped_bit_costs_its_own_chunk_only_and_is_never_data(victim: Victim, tmp_path: Path) -> None:
    for bit in np.random.default_rng(2).integers(0, 8 * len(victim.data), 40):
        outcome = flipped(victim, int(bit), tmp_path)
        assert (outcome.lost_whole, outcome.invented) == (0, 0), f"bit {bit}"


def test_a_flipped_bit_in_the_head_of_a_file_loses_nothing(victim: Victim, tmp_path: Path) -> None:
    """The head is not covered by a chunk's checksum: magic bytes, header, both copies of the manifest."""
    first_chunk = victim.chunks[0][0]
    for byte in range(0, first_chunk, 97):
        outcome = flipped(victim, 8 * byte + byte % 8, tmp_path)
        assert (outcome.lost_whole, outcome.invented) == (0, 0), f"byte {byte}"


def test_a_flipped_bit_between_chunks_loses_nothing(victim: Victim, tmp_path: Path) -> None:
    start, end, _ = victim.chunks[1]
    for byte in [*range(start, start + 60, 3), *range(end, end + 60, 3)]:
        outcome = flipped(victim, 8 * byte + byte % 8, tmp_path)
        assert (outcome.lost_whole, outcome.invented) == (0, 0), f"byte {byte}"


def test_no_bit_of_a_finished_log_can_flip_unnoticed(tmp_path: Path) -> None:
    whole = whole_file(tmp_path / "whole")
    for bit in np.random.default_rng(3).integers(0, 8 * len(whole), 60):
        assert strict_reader_notices(whole, int(bit), tmp_path), f"bit {bit}"


def test_readers_agree_on_what_a_full_disk_has_left(tmp_path: Path) -> None:
    assert "60 records made" in full_disk(tmp_path)


def test_tables_are_right_or_refused_whatever_bit_flips(tmp_path: Path) -> None:
    whole = whole_file(tmp_path / "whole")
    for bit in np.random.default_rng(5).integers(0, 8 * len(whole), 8):
        assert table_reader_is_right(whole, int(bit), tmp_path), f"bit {bit}"


def test_a_killed_process_leaves_all_but_its_last_moments(tmp_path: Path) -> None:
    """`make torture` measures how long those are; a busy machine may stretch them here."""
    assert seconds_lost_by_kill(tmp_path, seed=1) < 5.0


def test_a_pulled_plug_leaves_what_was_synced(tmp_path: Path) -> None:
    lost = seconds_lost_by_power_cut(tmp_path, seed=4, cuts=8)
    assert len(lost) == 8
    assert min(lost) >= 0.0
    assert np.median(lost) < 0.5  # of a uniform 0 .. 0.4 s
