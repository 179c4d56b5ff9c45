"""A report in a real browser: it opens alone, without a fault, and its controls do what they say.

Needs Chromium; skipped where there is none.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import Page, browser
from numpy.typing import NDArray
from PIL import Image
from recorded_run import record_run
from report_samples import pose_of, write_fleet

from hippomat_core import messages as m
from hippomat_logs.cli import main
from hippomat_logs.recorder import Recorder

pytestmark = pytest.mark.timeout(300)  # the first page of a cold browser

ATTACK = "<script>window.pwned = 1</script><img src=x onerror='window.pwned = 2'>"
READY = "Boolean(window.hippomatReport)"
ROBOTS = 3
XS = "Array.from(hippomatReport.doc.get_model_by_name('robots').data.x)"
YS = "Array.from(hippomatReport.doc.get_model_by_name('robots').data.y)"
TIME = "Number(document.getElementById('time').value)"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


def attack(recorder: Recorder, stamp_ns: int) -> None:
    """What a hostile peer or a careless integrator could put into a log's texts."""
    recorder.put(stamp_ns, m.AlarmRaised(m.ERROR, ATTACK, ATTACK))
    recorder.put(stamp_ns, m.ConflictSeen(1, 0, 2, True, ATTACK))
    recorder.put(stamp_ns, m.GuardLimited(0.2, 0.0, 0.1, 0.1, 0.1, 0.0))
    recorder.put(stamp_ns, m.RecoveryChanged("back_up", ATTACK, 9.0, 0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def fleet_html(tmp_path_factory: pytest.TempPathFactory) -> Path:
    logs = tmp_path_factory.mktemp("fleet")
    write_fleet(logs, robots=ROBOTS, seconds=6.0, host=ATTACK, extra=attack)
    return made(logs)


def made(logs: Path) -> Path:
    out = logs / "report.html"
    assert main(["report", str(logs), "-o", str(out), "--trust-clocks"]) == 0
    return out


@pytest.fixture
def fleet(page: Page, fleet_html: Path) -> Page:
    show(page, fleet_html)
    return page


def show(page: Page, path: Path, width: int = 1280, height: int = 800) -> None:
    page.problems.clear()
    page.requests.clear()
    page.open(path, width, height)
    page.wait_for(READY)


def pixels(page: Page) -> NDArray[np.int16]:
    """(H, W, 3) of the map."""
    box = page.run(
        "(() => { const b = document.querySelector('.stage').getBoundingClientRect();"
        " return {x: b.x, y: b.y, width: b.width, height: b.height, scale: 1}; })()"
    )
    data = page.call("Page.captureScreenshot", format="png", clip=box)["data"]
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"), np.int16)


def settled(page: Page) -> None:
    """Bokeh paints in the next frame."""
    page.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(0))))")


def slide(page: Page, at_s: float) -> None:
    page.run(
        f"(() => {{ const s = document.getElementById('time'); s.value = {at_s};"
        " s.dispatchEvent(new Event('input')); })()"
    )
    settled(page)


def place_of(page: Page, figure: str, x: float) -> tuple[float, float]:
    """Where on the screen a time of a figure is, in the middle of its height."""
    page.run(f"document.getElementById('place_{figure}').scrollIntoView({{block: 'center'}})")
    found: Any = page.run(
        f"(() => {{ const model = hippomatReport.doc.get_model_by_name('{figure}');"
        " const view = Bokeh.index.find_one(model), box = view.el.getBoundingClientRect(), f = view.frame;"
        f" return [box.x + f.x_scale.compute({x}), box.y + f.bbox.top + f.bbox.height / 2]; }})()"
    )
    return float(found[0]), float(found[1])


def test_it_opens_without_a_fault_and_asks_no_network(fleet: Page) -> None:
    slide(fleet, 3.0)
    assert fleet.problems == []
    assert [url for url in fleet.requests if not url.startswith(("file:", "data:", "blob:"))] == []
    drawn = fleet.run("hippomatReport.doc.roots().map((root) => root.name)")
    assert set(drawn) == {"map", "gantt", "events", "delivery", "latency"}


def test_the_slider_moves_the_robots_to_where_they_were(fleet: Page) -> None:
    slide(fleet, 0.5)
    before = pixels(fleet)
    slide(fleet, 4.5)
    for k, (x, y) in enumerate(zip(fleet.run(XS), fleet.run(YS), strict=True)):
        x_m, y_m, _ = pose_of(k, ROBOTS, 4.5)
        assert (x, y) == pytest.approx((x_m, y_m), abs=0.06)
    changed = np.abs(pixels(fleet) - before).max(axis=2) > 40
    assert changed.sum() > 200  # bodies, trails and tasks have moved on the screen, not only in the data
    assert fleet.run("document.getElementById('clock').textContent") == "4.5 s"
    assert fleet.run("document.querySelector('#now td').textContent") == "idle"


def test_keys_move_the_slider(fleet: Page) -> None:
    slide(fleet, 1.0)
    fleet.run("document.getElementById('time').focus()")
    fleet.press("ArrowRight", 39)
    assert fleet.run(TIME) == pytest.approx(1.1)
    fleet.press("End", 35)
    assert fleet.run(TIME) == pytest.approx(fleet.run("Number(document.getElementById('time').max)"))
    said = fleet.run("document.getElementById('time').getAttribute('aria-valuetext')")
    assert said == "6.0 seconds of 6.0"


def test_play_runs_the_time_and_pause_stops_it(fleet: Page) -> None:
    slide(fleet, 0.0)
    fleet.run("document.getElementById('play').click()")
    fleet.wait_for(f"{TIME} > 0.3")
    fleet.run("document.getElementById('play').click()")
    stood = fleet.run(TIME)
    settled(fleet)
    assert fleet.run(TIME) == stood
    fleet.run("document.getElementById('play').click()")
    fleet.wait_for("document.getElementById('play').getAttribute('aria-pressed') === 'false'")  # at the end
    assert fleet.run(TIME) == pytest.approx(fleet.run("Number(document.getElementById('time').max)"))
    assert fleet.problems == []


@pytest.mark.parametrize("figure", ["gantt", "events"])
def test_a_click_on_a_figure_over_time_goes_to_that_time(fleet: Page, figure: str) -> None:
    slide(fleet, 0.0)
    fleet.click(*place_of(fleet, figure, 3.2))
    fleet.wait_for(f"{TIME} > 0")
    assert fleet.run(TIME) == pytest.approx(3.2, abs=0.1)
    for name in ("gantt", "events"):
        x, _ = place_of(fleet, name, 3.2)
        line = fleet.run(f"document.getElementById('cursor_{name}').getBoundingClientRect().x")
        assert line == pytest.approx(x, abs=2.0)


def test_the_time_of_an_alarm_is_a_way_to_it(fleet: Page) -> None:
    slide(fleet, 0.0)
    fleet.run("document.querySelector('.go').click()")
    assert fleet.run(TIME) == pytest.approx(6.0, abs=0.2)


def test_no_text_of_a_log_runs_as_a_script(page: Page, tmp_path: Path) -> None:
    write_fleet(tmp_path, robots=1, seconds=6.0, host=ATTACK, extra=attack)
    show(page, made(tmp_path))
    slide(page, 5.9)
    for figure in ("events", "gantt"):  # hover shows the texts too
        x, y = place_of(page, figure, 5.9)
        for dy in (-26, 0, 26):
            page.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y + dy)
            settled(page)
    assert page.run("typeof window.pwned") == "undefined"
    assert ATTACK in page.run("document.body.textContent")
    assert page.run("hippomatReport.doc.get_model_by_name('conflicts') !== null")
    assert page.problems == []


def test_thirty_robots_fit_and_so_does_a_narrow_window(page: Page, tmp_path: Path) -> None:
    write_fleet(tmp_path, robots=30, seconds=0.5)
    show(page, made(tmp_path), 400, 800)
    slide(page, 0.4)
    assert len(page.run(XS)) == 30
    assert page.run("document.documentElement.scrollWidth <= window.innerWidth")
    assert page.problems == []


def test_a_window_made_narrow_shows_no_part_beyond_its_edge(fleet: Page) -> None:
    slide(fleet, 5.5)
    fleet.size(420, 900)
    fleet.wait_for("document.documentElement.scrollWidth <= window.innerWidth")
    x, _ = place_of(fleet, "gantt", 5.5)
    line = fleet.run("document.getElementById('cursor_gantt').getBoundingClientRect().x")
    assert line == pytest.approx(x, abs=2.0)
    assert fleet.problems == []


@pytest.mark.parametrize("what", ["one robot and no map", "no tasks", "a core with all its devices"])
def test_what_a_log_does_not_hold_leaves_the_rest_whole(page: Page, tmp_path: Path, what: str) -> None:
    if what == "no tasks":
        write_fleet(tmp_path, robots=2, seconds=1.0, with_tasks=False)
    elif what == "one robot and no map":
        write_fleet(tmp_path, robots=1, seconds=1.0, with_map=False)
    else:
        record_run(tmp_path)
    show(page, made(tmp_path))
    slide(page, 0.6)
    assert len(page.run(XS)) >= 1
    assert page.problems == []
