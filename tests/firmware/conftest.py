"""Chips that run the real shell on fakes of ESP-IDF: both compilers, ports and forms of the send callback."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from chip import Chip, build_chip

BUILDS = {
    "gcc-usb": ("gcc", "-DIDF_MINOR=5"),
    "clang-uart": ("clang", "-DIDF_MINOR=4", "-DHIPPOMAT_HOST_PORT=hal_uart", "-DHIPPOMAT_GIT_HASH=0a1b2c3d"),
}


@pytest.fixture(scope="session", params=BUILDS)
def chip_program(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_chip(tmp_path_factory.mktemp("chip") / request.param, *BUILDS[request.param])


@pytest.fixture
def chip(chip_program: Path) -> Iterator[Callable[..., Chip]]:
    """Powers a chip on: what its flash holds, and what of it is broken. All are off after the test."""
    chips: list[Chip] = []

    def power_on(flash: dict[str, bytes] | None = None, *broken: str) -> Chip:
        chips.append(Chip(chip_program, flash))
        for what in broken:
            chips[-1].tell(f"break {what}")
        return chips[-1]

    yield power_on
    for each in chips:
        each.off()
