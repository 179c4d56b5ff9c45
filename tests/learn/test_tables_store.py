"""What was measured stays on the disk, and is found again for the same question only."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from world_samples import SMALL

from hippomat_core.errors import ConfigError
from hippomat_sim.bench import tables_cells as kinds
from hippomat_sim.bench.tables_cells import Cell, Plan
from hippomat_sim.bench.tables_measure import TEST_SPLIT, Bench
from hippomat_sim.bench.tables_run import run
from hippomat_sim.bench.tables_store import STORE_NAME, Store, code_hash, key_of, measured_modules
from hippomat_sim.learn.method_registry import Sources
from hippomat_sim.learn.world_pool import make_pool

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


def imported(module: str) -> Iterator[str]:
    """hippomat's modules that this one names in an import, wherever in it."""
    spec = find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    for node in ast.walk(ast.parse(Path(spec.origin).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hippomat_"):
            inside = find_spec(node.module).submodule_search_locations is not None
            for name in node.names:
                whole = f"{node.module}.{name.name}"
                yield whole if inside and find_spec(whole) is not None else str(node.module)


DECIDE_ON_NO_FIGURE = {
    "hippomat_core.errors",  # words
    "hippomat_logs.policy_files",  # where the packaged weights lie; their hash is in the key
    "hippomat_sim.bench.tables_machine",  # its name is in the key where it matters
    "hippomat_sim.bench.tables_cells",  # the cell is in the key
    "hippomat_sim.learn.runs",  # where a run's weights lie; their hash is in the key
    "hippomat_sim.learn.train_settings",  # read by training alone
}


def test_whatever_measuring_imports_is_part_of_the_key() -> None:
    due, found = ["hippomat_sim.bench.tables_measure"], set()
    while due:
        if (module := due.pop()) not in found | DECIDE_ON_NO_FIGURE:
            found.add(module)
            due += imported(module)
    assert "hippomat_core.wire.frames" in found
    assert "hippomat_sim.learn.networks.gcn" in found  # through an import inside a function
    hashed = {name.removesuffix(".__init__") for name in measured_modules()}
    assert found - hashed == set()


def test_decision_times_are_those_of_one_machine(tmp_path: Path) -> None:
    world = replace(SMALL, sites=48, starts=24)
    pool, plan = (
        make_pool(world, TEST_SPLIT, cache=False),
        Plan(("greedy",), (3,), 2, parts=("fixed", "time")),
    )

    def measured(machine: str) -> int:
        """Cells that were due."""
        told: list[int] = []
        store, bench = Store(tmp_path, fresh=False), Bench(world, Sources(tmp_path), 0, machine)
        run(plan, bench, pool, store, 1, lambda _about, done, _total: told.append(done))
        return told[-1] - told[0]

    assert measured("one") == len(plan.cells())
    assert measured("one") == 0
    assert measured("another") == len([cell for cell in plan.cells() if cell.kind == kinds.TIME])
