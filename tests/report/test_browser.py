"""Pages in a real browser: nothing fails, nothing is fetched, panels are drawn and linked, no text is cut."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import insnav
from insnav.errors.budget.error_budget import budget
from insnav.errors.budget.from_windows import BudgetStudy
from insnav.errors.budget.sources import at_rest
from insnav.errors.evaluated_run import EvaluatedRun
from insnav.errors.metrics import position_errors
from insnav.library import sample_drive
from insnav.messages import translated
from insnav.quantity import Quantity
from insnav.report.html import page_html
from insnav.report.page import Page, Section
from insnav.report.panels import Curve, Panel
from insnav.report.simulation.page import recording_page
from insnav.report.style import BLACK
from insnav.result import Result
from insnav.types import Smoothed
from tests.bench.processes import LOOP
from tests.errors.budget.imus import plain
from tests.report import drawn
from tests.report.synthetic import drive
from tests.report.test_certificate import CERTIFICATE, certificate_page
from tests.report.test_outage import page_of as outage_page
from tests.report.test_simulation import TOWN, plan_of, recording_of

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="no Chromium with chromedriver on this machine")
DRAWN = "return document.body.dataset.drawn || !document.querySelector('.panels') && document.readyState === 'complete'"
# elements whose text does not fit in them, or that stand out of the page
CUT = """
const all = "h1, h2, p, dt, dd, summary, figcaption, .legend label, .legend button";
return [...document.querySelectorAll(all)].filter(each => {
  const box = each.getBoundingClientRect();
  return box.width > 0 && (box.right > innerWidth + 1 || box.left < -1 || each.scrollWidth > each.clientWidth + 1
    && getComputedStyle(each).display !== "inline");
}).map(each => each.textContent.trim());
"""


class Browser:
    """One Chromium; every page is opened from its file."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, file: Path, width: int = 1280) -> None:
        """Open a page and wait until its panels are drawn."""
        from selenium.webdriver.support.ui import WebDriverWait

        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False},
        )
        for kind in ("browser", "performance"):
            self.logs(kind)
        self.driver.get(file.resolve().as_uri())
        WebDriverWait(self.driver, 60).until(lambda _: self.run(DRAWN))

    def run(self, script: str) -> Any:
        return self.driver.execute_script(script)

    def logs(self, kind: str) -> list[Any]:
        return list(self.driver.get_log(kind))

    def errors(self) -> list[str]:
        """What the console says: nothing, whatever its level."""
        return [each["message"] for each in self.logs("browser")]

    def requests(self) -> list[str]:
        """Everything that was fetched, the page apart."""
        sent = (json.loads(each["message"])["message"] for each in self.logs("performance"))
        urls = [each["params"]["request"]["url"] for each in sent if each["method"] == "Network.requestWillBeSent"]
        return [url for url in urls if not url.startswith(("file:", "data:"))]


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in ("headless", "no-sandbox", "disable-gpu", "disable-background-networking", "disable-dev-shm-usage"):
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    yield Browser(driver)
    driver.quit()


@pytest.fixture
def opened(browser: Browser, tmp_path: Path) -> Browser:
    """The page of every kind of panel, with names that try to escape."""
    file = tmp_path / "page.html"
    file.write_text(page_html(drawn.page(drawn.HOSTILE), {}), encoding="utf-8")
    browser.open(file)
    return browser


def test_it_is_drawn_without_an_error_and_without_the_network(opened: Browser) -> None:
    assert opened.errors() == []
    assert opened.requests() == []
    assert opened.run("return insnav.drawings.length") == 4
    assert opened.run("return insnav.drawings.every(each => each.view && each.frame.width > 100)")


def test_zoom_and_cursor_are_linked_and_the_switch_shows_the_outlier(opened: Browser) -> None:
    opened.run("insnav.drawings[1].x.setv({start: 1000, end: 1100})")
    assert opened.run("return [insnav.drawings[2].x.start, insnav.drawings[2].x.end]") == [1000, 1100]
    assert opened.run("return insnav.drawings[3].x.end") > 99  # not linked
    assert opened.run("return insnav.drawings[1].y.end") < 0.6
    opened.run("insnav.whole(insnav.drawings[2])")
    assert opened.run("return insnav.drawings[1].x.end") > 3500
    opened.run("insnav.follow(insnav.links.get('time'), 1800)")
    assert opened.run("return insnav.drawings.slice(1, 3).map(each => each.cursor.style.display)") == ["block", "block"]
    assert opened.run("return insnav.drawings[0].here.style.display") == "block"
    # half way the figure of eight is at 2000 sin(3), 1000 sin(6)
    assert opened.run(
        "const t = insnav.drawings[0]; return Math.abs(t.x.start + (parseFloat(t.here.style.left) - "
        "t.frame.left) / t.frame.width * (t.x.end - t.x.start) - 2000 * Math.sin(3)) < 30"
    )
    assert opened.run("return insnav.drawings[1].root.dataset.outliers") == "0"
    opened.run("document.querySelector('[data-mode=filtered]').click()")
    assert opened.run("return insnav.drawings[1].root.dataset.outliers") == "1"


def pointer(kind: str, x: float = 0.5, drawing: int = 1) -> str:
    """Script: an event of the pointer in the frame of a drawing, `x` of its width."""
    return (
        f"const d = insnav.drawings[{drawing}], b = d.place.getBoundingClientRect(), f = d.frame;"
        f"d.place.dispatchEvent(new PointerEvent('{kind}', {{clientX: b.left + f.left + {x} * f.width, "
        "clientY: b.top + f.top + 0.5 * f.height, pointerType: 'mouse', bubbles: true}))"
    )


def test_the_cursor_shows_the_time_and_values_with_units_and_leaves_with_the_pointer(opened: Browser) -> None:
    def texts(part: str) -> list[str]:
        script = f"return [...document.querySelectorAll('{part}')].map(each => each.textContent).filter(Boolean)"
        return list(opened.run(script))

    assert texts(".legend output") == []
    opened.run(pointer("pointermove"))
    stamps = texts(".cursor span")
    assert len(stamps) == 2  # of the linked panels
    for stamp in stamps:
        number, unit = stamp.split(" ")
        assert float(number) == pytest.approx(1800.0, abs=20.0)
        assert unit == "s"
    assert [text.split(" ")[1] for text in texts(".legend output") if " " in text] == ["m"]  # NIS has no unit
    opened.run(pointer("pointerleave"))
    assert texts(".legend output") == []
    shown = "return insnav.drawings.slice(1, 3).map(each => each.cursor.style.display)"
    assert opened.run(shown) == ["none", "none"]
    assert opened.run("return insnav.drawings[0].here.style.display") == "none"


def test_no_box_stands_about_what_is_clicked(opened: Browser) -> None:
    script = """
    const inside = (root, part) => root.querySelector(part).shadowRoot;
    const events = inside(inside(insnav.drawings[1].place, ".bk-Figure"), ".bk-Canvas").querySelector(".bk-events");
    events.tabIndex = 0; events.focus();
    return getComputedStyle(events).outlineStyle;
    """
    assert opened.run(script) == "none"


def test_the_switch_changes_the_figures_of_merit(browser: Browser, tmp_path: Path) -> None:
    sizes = {"smoothed": 0.25, "filtered": 0.75}
    merits = {mode: (Quantity("horizontal", size, "m"),) for mode, size in sizes.items()}
    page = replace(drawn.page(), merits=merits["smoothed"], merits_by=merits, merits_note="RMS, solution:")
    file = tmp_path / "page.html"
    file.write_text(page_html(page, {}), encoding="utf-8")
    browser.open(file)
    seen = (
        "return [...document.querySelectorAll('.merits dd, .merits + .note')].filter(each => each.offsetParent)"
        ".map(each => each.textContent.trim())"
    )
    for mode, text in (("smoothed", "0.250 m"), ("filtered", "0.750 m"), ("smoothed", "0.250 m")):
        browser.run(f"document.querySelector('[data-mode={mode}]').click()")
        assert browser.run(seen) == [text, f"RMS, solution: {mode}"]
    assert browser.run("return document.querySelectorAll('.switch').length") == 1


def test_margins_are_equal_and_rows_of_events_name_themselves_inside(browser: Browser, tmp_path: Path) -> None:
    names = ("a finding with a name that is much longer than any margin", "short")
    mark = Curve("event", np.array([600.0, 900.0]), np.arange(2.0), BLACK, "points", text=("a", "b"))
    events = Panel("events", "Events", "", "time [s]", (mark,), "time", rows=names, height=140)
    small = Curve("north", np.linspace(0.0, 3600.0, 50), np.linspace(0.0, 2e-4, 50), BLACK)
    fine = Panel("fine", "Fine", "error [m]", "time [s]", (small,), "time")
    page = replace(drawn.page(), sections=(Section("drawn", panels=(*drawn.panels(), fine, events)),))
    file = tmp_path / "page.html"
    file.write_text(page_html(page, {}), encoding="utf-8")
    for width in (390, 1280, 1920):
        browser.open(file, width)
        time.sleep(0.3)  # margins are levelled in the next frames
        lefts = browser.run("return insnav.drawings.filter(d => d.curves && d.link === 'time').map(d => d.frame.left)")
        assert len(lefts) == 4
        assert max(lefts) - min(lefts) <= 0.5
        assert max(lefts) < 120.0
    browser.run("insnav.follow(insnav.links.get('time'), 1800)")
    assert browser.run("return document.querySelectorAll('#events output').length") == 0  # no "event 0.00"


def test_the_map_stays_in_view_beside_the_panels(browser: Browser, tmp_path: Path) -> None:
    more = tuple(replace(each, key=f"{each.key}_{i}") for i in range(3) for each in drawn.panels()[1:3])
    file = tmp_path / "page.html"
    file.write_text(
        page_html(replace(drawn.page(), sections=(Section("drawn", panels=(*drawn.panels(), *more)),)), {}),
        encoding="utf-8",
    )
    where = "const b = document.getElementById('{}').getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom]"
    for width, columns in ((1280, 1), (1920, 2), (390, 0)):
        browser.open(file, width)
        browser.run("document.getElementById('nis_1').scrollIntoView({block: 'center'})")
        _, top, right, bottom = browser.run(where.format("map"))
        (left, upper, *_), (second, lower, *_) = (browser.run(where.format(name)) for name in ("error", "nis"))
        assert (top >= 0.0 and bottom <= 900.0) == (columns > 0)
        assert (left >= right) == (columns > 0)
        assert (abs(upper - lower) < 1.0 and second > left) == (columns == 2)


def test_dashed_lines_and_points_have_swatches_of_their_own(browser: Browser, tmp_path: Path) -> None:
    x = np.arange(3.0)
    kinds = ("line", "dashed", "points", "crosses", "band")
    curves = tuple(Curve(kind, x, x, BLACK, kind, x - 1.0 if kind == "band" else None) for kind in kinds)
    both = Curve("band and line", x, x, BLACK, "band", x - 1.0), Curve("band and line", x, x, BLACK)
    page = Page("p", (), (Section("s", panels=(Panel("a", "A", "y [m]", "x [s]", (*curves, *both)),)),))
    file = tmp_path / "page.html"
    file.write_text(page_html(page, {}), encoding="utf-8")
    browser.open(file)
    assert browser.run("return [...document.querySelectorAll('.legend i')].map(e => e.className)") == [*kinds, "line"]


def test_a_command_can_be_copied(browser: Browser, tmp_path: Path) -> None:
    line = "insnav run imu.csv --gps gps.csv"
    page = replace(drawn.page(), summary=(f"next        {line}", "about insnav run and others"))
    file = tmp_path / "page.html"
    file.write_text(page_html(page, {}), encoding="utf-8")
    browser.open(file)
    assert browser.run("return [...document.querySelectorAll('.command code')].map(e => e.textContent)") == [line]
    browser.driver.find_element("css selector", ".command button").click()
    assert browser.run("return document.querySelector('.command button').textContent") == "copied"


def test_pointing_at_the_map_moves_the_cursor(opened: Browser) -> None:
    opened.run("insnav.drawings[0].pointed([0.5, 0.5])")
    at = opened.run("return insnav.links.get('time').at")
    assert 0.0 <= at <= 3600.0
    assert opened.run("return insnav.drawings[1].cursor.style.display") == "block"


@pytest.mark.parametrize("width", [1920, 1280, 390])
def test_no_text_is_cut_and_a_metre_is_a_metre(browser: Browser, tmp_path: Path, width: int) -> None:
    file = tmp_path / "page.html"
    file.write_text(page_html(drawn.page(), {}), encoding="utf-8")
    browser.open(file, width)
    assert browser.run(CUT) == []
    assert browser.run("return document.documentElement.scrollWidth") <= width
    ratio = browser.run(
        "const t = insnav.drawings[0], f = t.frame; "
        "return f.width / (t.x.end - t.x.start) / (f.height / (t.y.end - t.y.start))"
    )
    assert ratio == pytest.approx(1.0, abs=0.01)


def test_a_shadow_shows_that_a_table_goes_on(browser: Browser, tmp_path: Path) -> None:
    rows = tuple(tuple(Quantity(f"column_{i}", 1.0 + i, "m") for i in range(12)) for _ in range(9))
    file = tmp_path / "page.html"
    file.write_text(page_html(Page("Wide", (), (Section("wide", "Wide", rows=rows),)), {}), encoding="utf-8")

    def edges(scrolled: str) -> list[float]:
        """Mean brightness of the last pixels at both ends of the table."""
        browser.run(f"document.querySelector('.wide').scrollLeft = {scrolled}")
        picture = browser.driver.find_element("css selector", ".wide").screenshot_as_png
        grey = np.asarray(Image.open(BytesIO(picture)).convert("L"), dtype=float)
        return [float(grey[:, side].mean()) for side in (slice(0, 3), slice(-3, None))]

    browser.open(file, 390)
    start, end = edges("0"), edges("9999")
    assert start[1] < start[0] - 30.0
    assert end[0] < end[1] - 30.0
    browser.open(file, 1920)
    assert np.ptp(edges("0")) < 20.0  # all of it is in view


@pytest.mark.parametrize("width", [1920, 1280, 390])
def test_the_page_of_a_run(browser: Browser, navigated: Any, tmp_path: Path, width: int) -> None:
    file = tmp_path / "report.html"
    file.write_text(page_html(navigated.page(), {}), encoding="utf-8")
    assert file.stat().st_size < 4e6
    browser.open(file, width)
    assert browser.errors() == []
    assert browser.requests() == []
    assert browser.run(CUT) == []
    assert browser.run("return document.documentElement.scrollWidth") <= width
    names = browser.run("return insnav.drawings.map(each => each.key)")
    assert names[:4] == ["track", "position_error", "velocity_error", "attitude_error"]
    legend = browser.run("return insnav.drawings[1].legend.textContent")
    assert translated("no GPS used") in legend
    assert browser.run("return insnav.drawings.every(each => each.place.querySelector('.bk-Figure'))")
    # an event: pointing at it shows its text, a click goes there
    browser.run(
        "const e = insnav.drawings.at(-1); e.hover(...e.pixel(e.curves[0].x[0], 0).map((each, i) => "
        "each / [e.frame.width, e.frame.height][i])); e.place.click()"
    )
    assert browser.run("return insnav.drawings.at(-1).tip.textContent") != ""
    assert browser.run(
        "const l = insnav.links.get('time'), x = insnav.drawings[1].x; "
        "return (x.end - x.start) / (l.whole[1] - l.whole[0]) < 0.03"
    )


@pytest.mark.parametrize("width", [1920, 1280, 390])
def test_a_budget_is_drawn_and_its_sources_can_be_pointed_at(browser: Browser, tmp_path: Path, width: int) -> None:
    found = budget(plain(), at_rest(20.0), (5.0, 10.0, 20.0), runs=10)
    file = tmp_path / "budget.html"
    file.write_text(page_html(Result("budget", BudgetStudy(found)).page(), {}), encoding="utf-8")
    browser.open(file, width)
    assert (browser.errors(), browser.requests()) == ([], [])
    assert browser.run(CUT) == []
    assert browser.run("return document.documentElement.scrollWidth") <= width
    assert browser.run("return insnav.drawings.map(each => each.key)") == ["growth", "contributions", "sources"]
    browser.run("const d = insnav.drawings[1], f = d.frame; d.pointed([0.02, 0.5 / d.rows.length])")
    assert "Half of it:" in browser.run("return insnav.drawings[1].tip.textContent")
    first = browser.run("return insnav.drawings[1].rows[0]")
    strong = "insnav.drawings[2].curves.filter(c => c.renderer.glyph.line_width.value === 4).map(c => c.name)"
    assert browser.run(f"return {strong}") == [first]


def _check() -> Page:
    return insnav.check(*sample_drive()).page()


def _allan() -> Page:
    rest = np.random.default_rng(1).normal(0.0, 1e-3, (2, 20_000, 3)) - np.array([[[0.0, 0, 0]], [[0.0, 0, 9.81]]])
    return insnav.allan(insnav.ImuData(0.01 * np.arange(20_000), *rest), taus="octave").page()


def _align() -> Page:
    still = np.random.default_rng(1).normal(0.0, 1e-4, (2, 6_000, 3)) - np.array([[[0.0, 0, 0]], [[0.0, 0, 9.81]]])
    still_imu = insnav.ImuData(0.01 * np.arange(6_000), *still)
    return insnav.align(still_imu, lat=0.8, imu="consumer").page()


def _calibrate() -> Page:
    rate = np.arange(-90.0, 91.0, 15.0)
    volts = np.minimum(0.2 + 0.05 * rate + 1e-4 * np.random.default_rng(1).standard_normal(len(rate)), 4.0)
    return insnav.calibrate("gyro", pd.DataFrame({"rate_dps": rate, "voltage_v": volts})).page()


def _platform() -> Page:
    force = pd.DataFrame(np.tile([0.0, 0.0, -9.8], (600, 1)), columns=["f_north", "f_east", "f_down"])
    return insnav.platform(force.assign(time=np.arange(600.0)), 0.8, 0.2, errors={"drift": np.full(3, 1e-7)}).page()


def _compare() -> Page:
    runs = [insnav.load(*sample_drive()[:2], ref=sample_drive()[2], explain="off").navigate(smooth=on) for on in (0, 1)]
    return insnav.compare(*runs, ref=sample_drive()[2]).page()


KINDS: dict[str, Callable[[], Page]] = {
    "check": _check,
    "allan": _allan,
    "align": _align,
    "calibrate": _calibrate,
    "platform": _platform,
    "compare": _compare,
    "outage": outage_page,
    "require": lambda: insnav.require("5 m", "30 s", runs=0).page(),
    "simulate": lambda: recording_page(plan_of(TOWN), recording_of(plan_of(TOWN))),
    "certificate": lambda: certificate_page(CERTIFICATE),
    "imus": lambda: insnav.imus().page(),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_page_is_whole_at_three_widths(browser: Browser, tmp_path: Path, kind: str) -> None:
    file = tmp_path / f"{kind}.html"
    file.write_text(page_html(KINDS[kind](), {}), encoding="utf-8")
    for width in (390, 1280, 1920):
        browser.open(file, width)
        assert (browser.errors(), browser.requests()) == ([], [])
        assert browser.run(CUT) == []
        assert browser.run("return document.documentElement.scrollWidth") <= width


def test_the_page_of_an_hour_is_drawn_within_2_5_seconds_of_computing(browser: Browser, tmp_path: Path) -> None:
    """Time of the page's thread, on a computer whose calibration loop of 20 million products takes 1.27 s."""
    run, gps, true = drive(3600.0, rate=10.0)
    run = replace(run, smoothed=Smoothed(run.solution, run.epochs, run.sensor_errors))
    errors = position_errors(run.solution, true)
    html = page_html(Result("run", EvaluatedRun(run, gps, errors, errors)).page(), {})
    assert len(html.encode()) < 3.5e6
    file = tmp_path / "hour.html"
    file.write_text(html, encoding="utf-8")
    browser.driver.execute_cdp_cmd("Performance.enable", {"timeDomain": "threadTicks"})
    taken = []
    for _ in range(3):
        browser.open(file, 1280)
        found = browser.driver.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
        taken.append(next(each["value"] for each in found if each["name"] == "TaskDuration"))
    begin = process_time()
    exec(LOOP, {})
    assert min(taken) < 2.5 / 1.27 * (process_time() - begin), taken
