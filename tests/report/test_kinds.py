"""What the page of each kind shows first: its light, its drawing, its tables."""

from __future__ import annotations

import os
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import linregress

import insnav
from insnav.errors.evaluated_run import EvaluatedRun
from insnav.errors.metrics import position_errors
from insnav.findings import Code, Severity
from insnav.library import sample_drive
from insnav.messages import speaking
from insnav.quantity import Quantity
from insnav.report.html import page_html, translated
from insnav.report.page import Page, Section
from insnav.report.simulation.page import recording_page
from insnav.result import Result
from insnav.types import Smoothed
from insnav.units import DEG
from tests.report.conftest import stored
from tests.report.synthetic import drive
from tests.report.test_simulation import TOWN, plan_of, recording_of


def cells(html: str) -> dict[str, str]:
    """Class of every cell by its text."""
    return {text.strip(): kind for kind, text in re.findall(r'<t[dh][^>]*class="([^"]*)"[^>]*>([^<]*)<', html)}


def test_short_text_of_a_table_stands_left_and_numbers_right() -> None:
    rows = tuple(
        (Quantity("axis", axis), Quantity("class", kind), Quantity("error", size, "m"), Quantity("note", note))
        for axis, kind, size, note in (("x", "industrial", 1.5, "–"), ("y", "open", 20.0, "a"))
    )
    items = Quantity("method", "levelling"), Quantity("time", 2.5, "s")
    html = page_html(Page("p", (), (Section("t", "T", items), Section("r", "R", rows=rows))), {})
    assert '>error <span class="unit">[m]</span></th>' in html  # no line break within a unit
    found = cells(re.sub("</?span[^>]*>", "", html))
    for text in ("industrial", "open", "class", "levelling", "2.50", "note", "a"):
        assert found[text] == "text", text
    for number in ("1.50", "20.0", "error [m]"):
        assert found[number] == "", number


@pytest.mark.parametrize(
    ("key", "label"),
    [("imu_samples", "IMU samples"), ("nees_position", "NEES position"), ("maximum", "maximum"), ("nhc", "NHC")],
)
def test_abbreviations_are_upper_case(key: str, label: str) -> None:
    assert Quantity(key, 1.0).label == label


def test_an_hour_of_a_drive_makes_a_page_of_at_most_3_5_megabytes() -> None:
    run, gps, true = drive(3600.0, rate=10.0)
    run = replace(run, smoothed=Smoothed(run.solution, run.epochs, run.sensor_errors))
    errors = position_errors(run.solution, true)
    page = Result("run", EvaluatedRun(run, gps, errors, errors)).page()
    assert [*page.merits_by] == ["smoothed", "filtered"]
    html = page_html(page, {})
    assert len(html.encode()) < 3.5e6
    assert re.findall(r'data-of="(\w+)"( hidden)?>', html) == [("smoothed", ""), ("filtered", " hidden")]


@pytest.fixture(scope="module")
def checked() -> insnav.Result:
    imu, gps, ref = sample_drive()
    return insnav.check(imu, gps, ref)


def test_a_check_has_a_light_and_a_timeline_with_its_gaps(checked: insnav.Result) -> None:
    page = checked.page()
    assert (page.verdict.light, page.verdict.reason) == ("attention", "1 to mend")
    (timeline,) = page.panels
    assert timeline.rows == ("IMU, 100 Hz", "GPS, 1 Hz", "reference, 10 Hz")
    recorded, gap = timeline.curves
    ends = np.column_stack((recorded.low, recorded.x)) + 100000.01
    np.testing.assert_allclose(ends, [[100000.01, 100480.0], [100001.0, 100480.0], [100000.1, 100480.0]], atol=1e-6)
    time = insnav.read_gps(sample_drive()[1]).data.time
    longest = int(np.argmax(np.diff(time)))
    assert gap.y.tolist() == [1.0]
    np.testing.assert_allclose([gap.low[0], gap.x[0]], time[longest : longest + 2] - 100000.01, atol=1e-6)


@pytest.mark.skipif("INSNAV_REVERSED" in os.environ, reason="the words themselves are tested")
def test_nothing_is_to_mend_that_has_no_remedy(checked: insnav.Result) -> None:
    assert "mend 1: No lever arm" in checked.summary()
    hopeless = stored("the receiver was under a bridge", Severity.WARNING)
    again = replace(checked, found=replace(checked.found, problems=(hopeless,)))
    assert "no problem found" in again.summary()
    assert again.page().verdict.light == "good"


def test_an_alignment_has_a_light_that_says_whether_the_heading_is_known() -> None:
    time, earth = np.arange(0.01, 120.0, 0.01), 7.292115e-5
    lat = 48.0 * DEG
    rate = np.tile([earth * np.cos(lat), 0.0, -earth * np.sin(lat)], (len(time), 1))
    force = np.tile([0.0, 0.0, -9.8088], (len(time), 1))
    noise = np.random.default_rng(1).normal(0.0, 1e-6, (2, *rate.shape))
    still = insnav.ImuData(time, rate + noise[0], force + noise[1])
    known = insnav.align(still, lat=lat, imu="navigation").page().verdict
    assert (known.light, known.reason) == ("good", "the heading is known")
    unknown = insnav.align(still, lat=lat, imu="consumer").page().verdict
    assert (unknown.light, unknown.reason) == ("attention", "the heading is not known")
    assert "no heading" in unknown.sentence


def test_a_noise_page_has_one_table_a_sensor_with_the_letters_of_the_standard() -> None:
    rest = np.random.default_rng(1).normal(0.0, 1e-3, (2, 60_000, 3)) - np.array([[[0.0, 0, 0]], [[0.0, 0, 9.81]]])
    page = insnav.allan(insnav.ImuData(0.01 * np.arange(60_000), *rest), taus="octave").page()
    tables = [section for section in page.sections if section.title.startswith("Noise coefficients of the")]
    assert [table.title for table in tables] == [
        f"Noise coefficients of the {name}" for name in ("gyros", "accelerometers")
    ]
    for table in tables:
        assert [row[0].value for row in table.rows] == ["x", "y", "z"]
        assert table.rows[0][1].label == "random walk N"
    assert "random walk N" in page.verdict.sentence
    assert page.verdict.sentence.startswith("Gyros: ")


def test_a_calibration_shows_the_output_over_the_rate_with_the_line_and_what_was_left_out() -> None:
    rate = np.arange(-90.0, 91.0, 15.0)
    volts = np.minimum(0.2 + 0.05 * rate + 1e-4 * np.random.default_rng(1).standard_normal(len(rate)), 4.0)
    result = insnav.calibrate("gyro", pd.DataFrame({"rate_dps": rate, "voltage_v": volts}))
    output, residual = result.page().panels
    line, used, left_out = output.curves
    assert (line.kind, used.kind, left_out.kind) == ("line", "points", "crosses")
    np.testing.assert_array_equal(left_out.x, [90.0])
    np.testing.assert_allclose(left_out.y, [4.0])
    fit = linregress(rate[:-1], volts[:-1])
    np.testing.assert_allclose(line.y, fit.intercept + fit.slope * rate, atol=1e-6)
    assert residual.title.startswith("Residuals of")


def test_a_simulation_has_its_map_beside_its_panels_and_the_next_command() -> None:
    plan = plan_of(TOWN)
    html = page_html(recording_page(plan, recording_of(plan)), {})
    assert html.count('<div class="panels') == 1
    assert '<div class="panels of1 mapped">' in html
    assert re.findall(r'<p class="command">next\s+<code>(insnav run [^<]*)</code>', html)


def test_names_stand_on_the_lines_of_the_imus_nearest_to_a_requirement_and_bars_differ() -> None:
    page = insnav.require("5 m", "30 s", runs=0).page()
    alone = next(panel for panel in page.panels if panel.key == "parts_alone")
    named = [curve for curve in alone.curves if curve.kind == "line" and curve.text]
    assert len({curve.text for curve in named}) == len({curve.colour for curve in named}) == 6
    (bars,) = next(panel for panel in page.panels if panel.key == "allocation").curves
    assert bars.x.max() > 5.0 * np.median(bars.x)


def test_cases_that_were_not_asked_for_or_have_no_data_are_no_warnings() -> None:
    for code in (Code.REGRESSION_NOT_QUICK, Code.REGRESSION_NO_DATA):
        assert code.severity is Severity.NOTE


def test_a_drive_is_drawn_before_it_is_navigated() -> None:
    imu, gps, ref = sample_drive()
    recorded = insnav.load(imu, gps=gps, ref=ref)
    figure = recorded.plot()
    titles = [axes.get_title("left") for axes in figure.axes]
    assert titles == ["Angular rate", "Specific force", "Fixes, relative to the first", "Velocity of the fixes"]
    rate, force, fixes, _ = figure.axes
    down = fixes.lines[2].get_ydata()
    height = recorded.gps.data.lla[:, 2]
    np.testing.assert_allclose(down, height[0] - height, atol=0.6)  # the Earth is round
    assert np.median(force.lines[2].get_ydata()) == pytest.approx(-9.8, abs=0.2)
    largest = np.degrees(np.abs(recorded.imu.data.gyro[:, 2]).max())
    assert np.abs(rate.lines[2].get_ydata()).max() == pytest.approx(largest)
    ((begin, _), (end, _)) = rate.patches[0].get_bbox().get_points()
    assert end - begin == pytest.approx(21.0, abs=0.01)
    increments = replace(recorded.imu.data, gyro=0.01 * recorded.imu.data.gyro, accel=0.01 * recorded.imu.data.accel)
    increments = replace(increments, sampling="increment")
    again = insnav.load(increments, gps=gps).plot()
    drawn = (np.sort(figure.lines[2].get_ydata()) for figure in (again.axes[1], force))
    np.testing.assert_allclose(*drawn, rtol=1e-3)


@pytest.mark.skipif("INSNAV_REVERSED" in os.environ, reason="the words themselves are tested")
def test_a_page_in_chinese_has_no_english_titles_headings_or_labels(navigated: Result) -> None:
    names = {"NIS", "NEES", "GPS", "IMU", "", "gps", "imu", "CEP"}
    with speaking("zh"):
        html = page_html(navigated.page(), {})
        labels = [translated(text) for panel in navigated.page().panels[1:] for text in (panel.x_label, panel.y_label)]
    assert '<html lang="zh">' in html
    titles = re.findall(r"<figcaption><b>(.*?)</b>", html) + re.findall(r"<summary>(.*?)</summary>", html)
    headings = re.findall(r"<th[^>]*>([^<]*)</th>", html)
    assert len(titles) > 15
    for text in (*titles, *headings, *labels):
        assert text.partition(" [")[0] in names or re.search("[\u4e00-\u9fff]", text), text
    assert speak_zh("CEP50 0.487 m, R95 0.884 m") == "CEP50 为 0.487 m，R95 为 0.884 m"
    assert translated("CEP50 0.487 m, R95 0.884 m") == "CEP50 0.487 m, R95 0.884 m"


def speak_zh(text: str) -> str:
    with speaking("zh"):
        return translated(text)
