"""What was measured stays on the disk, and is found again for the same question only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hippomat_core.errors import ConfigError
from hippomat_sim.bench import tables_cells as kinds
from hippomat_sim.bench.tables_cells import Cell
from hippomat_sim.bench.tables_store import STORE_NAME, Store, code_hash, key_of

CELL = Cell(kinds.ONE_SHOT, "greedy", 3, 3, 2)
FIGURES = {"single": np.array([3, 2]), "rounds": np.array([1, 2])}


def test_what_was_stored_is_there_again(tmp_path: Path) -> None:
    key = key_of(CELL, {"seed": 1})
    Store(tmp_path, fresh=True).put(key, FIGURES)
    found = Store(tmp_path, fresh=False).get(key)
    assert found is not None
    assert {name: values.tolist() for name, values in found.items()} == {"single": [3, 2], "rounds": [1, 2]}
    assert Store(tmp_path, fresh=False).get(key_of(CELL, {"seed": 2})) is None
    assert Store(tmp_path, fresh=True).get(key) is None


def test_a_line_that_was_cut_off_is_measured_again(tmp_path: Path) -> None:
    store = Store(tmp_path, fresh=True)
    keys = [key_of(CELL, {"seed": seed}) for seed in range(3)]
    for key in keys:
        store.put(key, FIGURES)
    path = tmp_path / STORE_NAME
    path.write_bytes(path.read_bytes()[:-20])
    again = Store(tmp_path, fresh=False)
    assert [again.get(key) is not None for key in keys] == [True, True, False]
    again.put(keys[2], FIGURES)
    assert all(Store(tmp_path, fresh=False).get(key) is not None for key in keys)


@pytest.mark.parametrize("line", ["{}", "[]", "nonsense", '{"key": {}, "figures": {"single": ["x"]}}'])
def test_a_damaged_store_is_refused_by_line(tmp_path: Path, line: str) -> None:
    (tmp_path / STORE_NAME).write_text(line + "\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"cells\.jsonl:1 is damaged"):
        Store(tmp_path, fresh=False)


def test_the_code_is_part_of_the_key() -> None:
    assert len(code_hash()) == 16
    assert code_hash() == code_hash()
