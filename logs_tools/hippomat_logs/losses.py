"""What a run has lost, told in one line per cause. Knows drop records, no file."""

from __future__ import annotations

from hippomat_logs.records import DropRecord


class Losses:
    """Drop records, summed up by their cause: shedding makes thousands."""

    def __init__(self) -> None:
        self._of: dict[str, list[int]] = {}  # by cause: first record, last one, how many, in how many places

    def add(self, drop: DropRecord) -> None:
        sums = self._of.setdefault(drop.cause, [drop.first, 0, 0, 0])
        self._of[drop.cause] = [sums[0], drop.last, sums[2] + drop.last - drop.first + 1, sums[3] + 1]

    def lines(self) -> list[str]:
        shown = []
        for cause, (first, last, count, places) in self._of.items():
            which = f"records {first}..{last}"
            shown.append(
                f"{which if places == 1 else f'{count} of the {which}, in {places} places,'} lost: {cause}"
            )
        return shown
