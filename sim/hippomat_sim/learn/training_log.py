"""What a training run leaves behind: metrics.jsonl, one line per update, and the same for TensorBoard."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from torch.utils.tensorboard import SummaryWriter

METRICS = "metrics.jsonl"


def read_metrics(folder: Path) -> list[dict[str, Any]]:
    """The rows of a run so far; a last line that a power cut left unfinished does not count."""
    path = folder / METRICS
    rows = []
    for line in path.read_text("utf-8").splitlines() if path.is_file() else ():
        try:
            rows.append(json.loads(line))
        except ValueError:
            break
    return rows


class TrainingLog:
    """Appends rows. A resumed run drops the rows after its checkpoint, because it will write them again."""

    def __init__(self, folder: Path, update: int) -> None:
        """update: how many updates the run has done; rows of later ones are dropped."""
        folder.mkdir(parents=True, exist_ok=True)
        self.rows = [row for row in read_metrics(folder) if row["update"] <= update]
        kept = "".join(json.dumps(row) + "\n" for row in self.rows)
        (folder / METRICS).write_text(kept, "utf-8")
        self._file = (folder / METRICS).open("a", encoding="utf-8")
        steps = self.rows[-1]["agent_steps"] if self.rows else 0
        self._board = SummaryWriter(str(folder / "tensorboard"), purge_step=steps + 1 if steps else None)

    def add(self, row: dict[str, Any]) -> None:
        """row: numbers by name with "update" and "agent_steps"; "evaluation" holds figures by size."""
        self.rows.append(row)
        self._file.write(json.dumps(row) + "\n")
        self._file.flush()
        at = row["agent_steps"]
        for name, figure in row.items():
            if isinstance(figure, (int, float)) and name not in ("update", "agent_steps"):
                self._board.add_scalar(f"training/{name}", figure, at)
        for size, figures in row.get("evaluation", {}).items():
            for name, figure in figures.items():
                self._board.add_scalar(f"evaluation/{name}_{size}", figure, at)

    def close(self) -> None:
        self._file.close()
        self._board.close()
