"""What a reader does with a page, in a real browser; skipped where there is none."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, Browser
from stored import CROSSING, ROBOT, Fleet, a_cell, a_drive, a_record, store

from navbench.contract import Pose
from navbench.records import CellKey, RobotRecord
from navbench.report.packed import packed_layouts
from navbench.report.reports import write_report
from navbench.robot import Robot
from navbench.sensors import Mount, Sensors
from navbench.simulation.options import SimulatorOptions
from navbench.simulation.planar import PlanarSimulator
from navbench.validation import describe
from navbench.world.grid import Grid
from navbench.world.layout import Layout, Start
from navbench.world.shapes import Bounds, Box, Disc, Mover, Point, Polygon, Wall
from navbench.world.world import drawn

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")

PLAYED = "!document.getElementById('player').hidden"
RING = {
    "drawn_for_radius_m": 0.1,
    "max_range_m": 1.0,
    "mounts": [{"role": "left", "x_m": 0.0, "y_m": 0.1, "heading_rad": math.pi / 2}],
}


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two controllers in one world and a fleet among movers; of twelve episodes of B every third fails."""
    path = tmp_path_factory.mktemp("page")
    ends = [("reached", "collided", "reached")[i % 3] for i in range(12)]
    cells: list[tuple[CellKey, list[RobotRecord | Fleet]]] = [
        (a_cell("A"), [a_record(time_s=9.0 + i) for i in range(6)]),
        (a_cell("B", kp=2.0), [a_record(end, 6.0 + i, traceback="why" * (i == 1)) for i, end in enumerate(ends)]),
    ]
    cells[1][0].configuration["sensors"].update(RING)
    places = [(1.0 + i, 5.0) for i in range(5)]
    fleet = [a_drive([1.0] * 4, index=i, places=[(x, y + i) for x, y in places], behavior=[0, 1, 1, 0]) for i in (0, 1)]
    cells.append((a_cell("C", "crossing", scene=CROSSING), [fleet]))
    write_report([store(path / "in", cells).results], path / "out")
    return path / "out/report.html"


@pytest.fixture(scope="module")
def one_browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()


@pytest.fixture
def browser(one_browser: Browser, page: Path) -> Iterator[Browser]:
    """The page, just opened; at the end the console has said nothing of an error."""
    one_browser.size(1280, 900)
    one_browser.open(page, PLAYED)
    yield one_browser
    assert one_browser.errors == []


def column(browser: Browser, table: str, heading: str) -> list[str]:
    """Return the entries of a column that are shown, in their order."""
    told: list[str] = browser.ask(
        f"""(() => {{
            const table = document.querySelector("table[data-name={table}]");
            const heads = [...table.querySelectorAll("thead tr:last-child th")].map(head => head.dataset.column);
            const place = heads.indexOf({json.dumps(heading)});
            const rows = [...table.tBodies[0].rows].filter(row => !row.hidden);
            return rows.map(row => row.cells[place].textContent.trim());
        }})()"""
    )
    return told


def head_of(table: str, heading: str) -> str:
    return f"document.querySelector('table[data-name={table}] th[data-column=\"{heading}\"]')"


def test_a_click_and_a_key_on_a_heading_sort_a_table_by_its_numbers(browser: Browser) -> None:
    head = head_of("episodes", "time [s]")
    browser.ask(f"{head}.querySelector('button').click()")
    rising = [float(text) for text in column(browser, "episodes", "time [s]")]
    assert rising == sorted(rising)
    assert len(rising) == 20
    assert browser.ask(f"{head}.getAttribute('aria-sort')") == "ascending"
    browser.ask(f"{head}.querySelector('button').focus()")
    browser.press("Enter", 13)
    assert [float(text) for text in column(browser, "episodes", "time [s]")] == sorted(rising, reverse=True)
    assert browser.ask(f"{head}.getAttribute('aria-sort')") == "descending"
    browser.ask(f"{head_of('episodes', 'outcome')}.querySelector('button').click()")
    assert browser.ask(f"{head}.getAttribute('aria-sort')") == "none"
    assert column(browser, "episodes", "outcome") == sorted(column(browser, "episodes", "outcome"))


def test_what_is_missing_stays_last_however_a_table_is_sorted(browser: Browser) -> None:
    head = f"{head_of('summary', 'makespan [s]')}.querySelector('button')"
    for _ in range(2):
        browser.ask(f"{head}.click()")
        shown = column(browser, "summary", "makespan [s]")
        assert "–" not in shown or shown[-1] == "–"


def test_words_and_values_filter_a_table_and_say_how_many_are_left(browser: Browser) -> None:
    bar = "document.querySelector('#rows').closest('.tabled').querySelector('.bar')"
    browser.ask(f"{bar}.querySelector('select[data-column=outcome]').value = 'collided'")
    browser.ask(f"{bar}.querySelector('select[data-column=outcome]').dispatchEvent(new Event('input'))")
    assert column(browser, "episodes", "outcome") == ["collided"] * 4
    browser.ask(f"{bar}.querySelector('input').focus()")
    browser.call("Input.insertText", text="WHY")
    assert column(browser, "episodes", "episode") == ["1"]
    assert browser.ask(f"{bar}.querySelector('output').value") == "1 of 20 rows"


def test_an_outcome_at_the_top_leads_to_its_rows(browser: Browser) -> None:
    browser.ask("document.querySelector('.chips [data-outcome=collided]').click()")
    assert column(browser, "episodes", "outcome") == ["collided"] * 4


def test_a_failure_is_played_by_one_click_on_its_row(browser: Browser) -> None:
    browser.ask("[...document.querySelectorAll('#rows tbody tr.o-collided')].at(-1).cells[1].click()")
    assert "B in plain" in browser.ask("document.getElementById('which').textContent")
    assert browser.ask("document.querySelector('#rows tr[aria-current]').className") == "o-collided"
    before = browser.ask("document.getElementById('which').textContent")
    browser.ask("document.getElementById('next').click()")
    assert browser.ask("document.getElementById('which').textContent") != before
    assert browser.ask("document.querySelector('#rows tr[aria-current]').className") == "o-collided"


def test_what_a_controller_raised_is_shown_with_its_episode(browser: Browser) -> None:
    browser.ask(
        "[...document.querySelectorAll('#rows tbody tr')].find(row => row.querySelector('pre')).cells[1].click()"
    )
    assert browser.ask("document.querySelector('#raised pre').textContent") == "why"
    assert not browser.ask("document.getElementById('raised').hidden")


def test_play_runs_to_the_end_and_pause_stops(browser: Browser) -> None:
    browser.ask("document.getElementById('speed').value = 4; document.getElementById('play').focus()")
    browser.press(" ", 32)
    assert browser.ask("document.getElementById('play').textContent") == "Pause"
    browser.wait("document.getElementById('time').value > 1")
    browser.press(" ", 32)
    stopped = browser.ask("document.getElementById('time').value")
    assert (
        browser.ask("new Promise(done => setTimeout(() => done(document.getElementById('time').value), 200))")
        == stopped
    )
    browser.ask("document.getElementById('speed').value = 16; document.getElementById('play').click()")
    browser.wait("document.getElementById('play').textContent === 'Play'")
    assert browser.ask("+document.getElementById('time').value === +document.getElementById('time').max")


def test_the_slider_and_the_plots_lead_to_an_instant_and_tell_of_it(browser: Browser) -> None:
    place = "[...document.querySelectorAll('#rows tbody tr')].find(row => row.cells[1].textContent === 'C')"
    browser.ask(f"{place}.cells[1].click()")
    browser.ask("document.getElementById('time').focus()")
    browser.press("ArrowRight", 39)
    assert browser.ask("+document.getElementById('time').value") == pytest.approx(4.0 / 200.0)
    browser.ask("document.getElementById('plot-w').scrollIntoView()")
    x, y = browser.ask(
        "(() => { const box = document.getElementById('plot-w').getBoundingClientRect();"
        " return [box.left + 8 + (box.width - 16) * 0.375, box.top + 20]; })()"
    )
    browser.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, button="left", buttons=1, clickCount=1)
    assert browser.ask("+document.getElementById('time').value") == pytest.approx(1.5, abs=0.05)
    told = browser.ask("document.getElementById('instant').textContent")
    assert told.startswith("Robot 1 at (2.5")
    assert "behavior 1" in told
    browser.ask("document.getElementById('robot').value = 1")
    browser.ask("document.getElementById('robot').dispatchEvent(new Event('input'))")
    assert "Robot 2 at (2.5" in browser.ask("document.getElementById('instant').textContent")


def test_rays_of_the_chosen_robot_are_cast_in_the_page(browser: Browser) -> None:
    browser.ask("document.querySelector('#rows tbody tr.o-collided').cells[1].click()")
    browser.ask(f"document.getElementById('time').value = {1.5 / 0.29}")
    browser.ask("document.getElementById('time').dispatchEvent(new Event('input'))")
    assert "left 0.30 m" in browser.ask("document.getElementById('instant').textContent")
    browser.ask("document.getElementById('rays').click()")
    assert "left" not in browser.ask("document.getElementById('instant').textContent")


def test_a_phone_shows_all_without_scrolling_sideways_and_the_dark_is_dark(browser: Browser, page: Path) -> None:
    browser.size(360, 740)
    browser.open(page, PLAYED)
    assert browser.ask("document.documentElement.scrollWidth") == 360
    assert not browser.ask("document.querySelector('nav details').open")
    light = browser.ask("getComputedStyle(document.body).backgroundColor")
    browser.size(360, 740, dark=True)
    assert browser.ask("getComputedStyle(document.body).backgroundColor") != light


def test_the_page_casts_rays_and_moves_movers_as_the_simulator_does(browser: Browser) -> None:
    rng = np.random.default_rng(2)
    occupied = rng.random((12, 16)) < 0.2
    triangle = (Point(-2.5, -1.5), Point(-1.5, -2.0), Point(-1.8, -0.9))
    layout = Layout(
        bounds=Bounds(-5.0, 5.0, -5.0, 5.0),
        boxes=(Box(2.0, 1.0, 0.8, 0.4, 0.3),),
        discs=(Disc(-1.0, 2.0, 0.5),),
        polygons=(Polygon(corners=triangle),),
        walls=(Wall(-4.0, -4.0, 4.0, -3.0),),
        movers=(
            Mover(radius_m=0.4, waypoints=(Point(0.0, 4.0), Point(3.0, 3.0)), speeds_mps=(0.5,), phase_s=1.0),
            Mover(
                radius_m=0.5,
                waypoints=(Point(-4.0, 0.0), Point(-3.0, 1.0), Point(-4.0, 2.0)),
                speeds_mps=(0.5, 0.2, 0.4),
                cyclic=True,
                outline=(Point(0.4, 0.0), Point(-0.2, 0.3), Point(-0.2, -0.3)),
            ),
        ),
        grid=Grid.of(occupied, 0.1, 1.0, -2.0),
        starts=(Start(0.0, 0.0),),
        goals=(Point(0.0, -1.0),),
    )
    angles = np.linspace(-math.pi, math.pi, 181)
    mounts = tuple(Mount(role=f"r{i}", x_m=0.0, y_m=0.0, heading_rad=float(a)) for i, a in enumerate(angles))
    sensors = Sensors(drawn_for_radius_m=0.1, max_range_m=4.0, mounts=mounts)
    world = drawn(layout, "w", 0.1, 60.0)
    packed, _ = packed_layouts({0: world})
    moved = browser.ask(
        f"""(async () => {{
            const [layout] = await unpackLayouts(await inflated({json.dumps(packed)}));
            return [0, 13.7].map(t => [layout.movers.map(mover => moverAt(mover, t)),
                {json.dumps(angles.tolist())}.map(angle => cast(0, 0, angle, 4, obstaclesAt(layout, t)))]);
        }})()"""
    )
    robot = describe(Robot, ROBOT, "robot")
    for t_s, (places, ranges) in zip((0.0, 13.7), moved, strict=True):
        assert np.abs(np.array(places) - [mover.place(t_s) for mover in world.movers]).max() < 1e-3
        then = replace(layout, movers=tuple(replace(mover, phase_s=mover.phase_s + t_s) for mover in layout.movers))
        with PlanarSimulator(SimulatorOptions(), robot, sensors, None) as simulator:
            simulator.reset(then, [Pose(0.0, 0.0, 0.0)], 0.1)
            expected = simulator.ranges()[0]
        assert (np.abs(np.array(ranges) - expected) < 2e-3).mean() > 0.98, "but for rays that graze a corner"
