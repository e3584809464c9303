"""Tables, sentences, figures and facts of recorded windows say what was found."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insnav.errors.budget.from_windows import RecordedBudget, Replicas, WindowSettings, recorded_budget
from insnav.errors.outage.gnss_outage import COMPONENTS
from insnav.findings import Code, Finding, Severity, of_code
from insnav.output.data_files import FILE, store
from insnav.report.budget.page import read_found, windows_drawings
from insnav.report.budget.windows import windows_assumptions, windows_sections, windows_sentences, windows_warnings
from insnav.report.figures import drawing
from insnav.report.page import Page, section_tables
from insnav.report.panels import limits_of
from insnav.report.save import section_facts
from insnav.report.terminal import page_text
from insnav.result import Result, open_result
from insnav.session.budget import BudgetSettings, budget_of_windows
from insnav.simulate.truth_from_track import Residual
from tests.errors.outage import drives


@pytest.fixture(scope="module")
def budget() -> RecordedBudget:
    settings = WindowSettings(length=30.0, spacing=20.0, uncalibrated=True)
    return recorded_budget(drives.injected(), drives.SPEC, None, settings)


def tables_of(budget: RecordedBudget):
    return [table for section in windows_sections(budget) for table in section_tables(section)]


def with_replicas(budget: RecordedBudget, factor: float) -> RecordedBudget:
    part = budget.calibrated
    recorded = part.growth.rms
    rms = recorded * factor * np.linspace(0.8, 1.2, 11)[:, None, None]
    made = Replicas(
        part.growth.times,
        rms,
        0.7 * factor * recorded,
        1.3 * factor * recorded,
        recorded,
        part.growth.reference,
        Residual(0.01, 0.02, 0.05, 1.0, 2.0, 1.0, 0.1, 0.0),
        (),
    )
    return replace(budget, calibrated=replace(part, replicas=made))


def test_tables_have_all_rows_and_times(budget: RecordedBudget):
    tables = tables_of(budget)
    titles = [table.title for table in tables]
    assert len(set(titles)) == len(titles) == 10
    first = tables[0]
    assert first.columns[1:] == ("10 s", "20 s", "30 s")
    assert [row[0] for row in first.rows] == list(COMPONENTS)
    rms, high, largest = first.rows[0][3].split(", ")
    assert float(rms) == pytest.approx(budget.calibrated.growth.rms[-1, 0], rel=0.01)
    assert float(rms) <= float(largest)
    assert float(high) <= float(largest)
    for table in tables:
        assert all(len(row) == len(table.columns) for row in table.rows)
        assert "nan" not in " ".join(text for row in table.rows for text in row)


def test_uncalibrated_sensor_errors_are_in_field_units(budget: RecordedBudget):
    (table,) = [t for t in tables_of(budget) if t.title.startswith("Constant") and "uncalibrated" in t.title]
    accel, gyro = ([float(text.split(" ± ")[0]) for text in row[1].split(", ")] for row in table.rows)
    np.testing.assert_allclose(accel, drives.SIGNS, rtol=0.1)
    np.testing.assert_allclose(gyro[:2], 10.0 * drives.SIGNS[:2], rtol=0.1)


def test_sentences_explain(budget: RecordedBudget):
    lines = windows_sentences(budget)
    text = " ".join(lines)
    assert "predicted" in text
    assert "explained" in text
    assert "of tilt or" in text
    assert "in a straight window only the sum of bias and tilt is observable" in text
    assert "times predicted" in text
    assert "effective sample size" in text


@pytest.mark.parametrize(("factor", "words"), [(1.0, "describe this recording"), (0.3, "worse"), (4.0, "better")])
def test_replicas_are_said_to_agree_or_not(budget: RecordedBudget, factor: float, words: str):
    made = with_replicas(budget, factor)
    (line,) = [text for text in windows_sentences(made) if "simulated replicas" in text]
    assert words in line
    warned = list(of_code(windows_warnings(made), Code.BUDGET_OUTSIDE_REPLICAS))
    assert [each.subject for each in warned] == ["calibrated"] * (factor != 1.0)


def test_what_is_not_explained_is_a_warning(budget: RecordedBudget):
    part = budget.calibrated
    wrong = tuple(replace(each, explained=False) for each in part.verdicts[:1])
    found = windows_warnings(replace(budget, calibrated=replace(part, verdicts=wrong)))
    (unexplained,) = of_code(found, Code.BUDGET_UNEXPLAINED)
    assert (unexplained.subject, unexplained["components"]) == ("calibrated", ("north",))
    assert unexplained["recorded_m"] == part.verdicts[0].recorded


def test_a_start_that_is_not_independent_is_a_warning(budget: RecordedBudget):
    start = Finding.of(Code.BUDGET_SMOOTHED_START)
    noted = replace(budget, notes=(start, Finding.of(Code.BUDGET_ALL_TURNING)))
    assert windows_warnings(noted)[0] == start
    assert start.severity is Severity.WARNING
    assert Code.BUDGET_ALL_TURNING not in {each.code for each in windows_warnings(noted)}
    assert Finding.of(Code.WINDOWS_PREDICTED) in windows_assumptions(noted)


def test_facts_are_json_with_units(budget: RecordedBudget):
    found = section_facts(windows_sections(with_replicas(budget, 1.0)))
    facts = json.loads(json.dumps(found, allow_nan=False))["recorded_windows"]
    calibrated = facts["calibrated"]
    assert calibrated["windows"] == budget.calibrated.windows.count
    assert calibrated["rms_corrected_m"]["north"][-1] == pytest.approx(budget.calibrated.growth.corrected[-1, 0])
    assert calibrated["replicas"]["inside_band"] is True
    assert facts["uncalibrated"]["sensors"]["accel_bias_mg"] == pytest.approx(list(drives.SIGNS), rel=0.1)
    assert facts["uncalibrated"]["by_motion"]["static"] is None
    assert facts["uncalibrated"]["diagnosis"]["north"]["acceleration"]["filter_sd_mg"] == pytest.approx(1.0, rel=0.3)


def test_page_and_figures(budget: RecordedBudget):
    made = with_replicas(budget, 1.0)
    text = page_text(Page("drive.csv", windows_sentences(made), windows_sections(made)))
    assert "nan" not in text
    figures = [figure for section in windows_drawings(made) for figure in section.figures]
    assert len({figure.name for figure in figures}) == len(figures) == 6
    for figure in figures:
        with drawing():
            drawn = figure.draw()
        for axes in (each for each in drawn.axes if each.axison):
            assert axes.get_ylabel().endswith("]")
            assert np.isfinite(axes.get_ylim()).all()


def test_what_was_found_in_the_drive_stands_on_the_page_and_in_the_folder(budget: RecordedBudget, tmp_path: Path):
    found = budget_of_windows(replace(budget, notes=()), BudgetSettings(times=(10.0, 30.0)))
    model = Finding.of(Code.IMU_MODEL_FROM_REST, 0.0, 70.0, gyro_noise_rad_sqrt_s=9e-5, preset="consumer")
    detected = (Finding.of(Code.RUN_LEVER_ZERO), model, Finding.of(Code.ESTIMATE_NOISE))
    made = Result("budget", found, findings=detected)
    assert set(detected) < set(made.page().findings)
    again = open_result(made.save(tmp_path / "budget", figures="none"))
    assert again.page().findings == made.page().findings
    assert set(again.findings) == set(made.page().findings)


def test_notes_that_were_texts_are_findings(budget: RecordedBudget, tmp_path: Path):
    found = budget_of_windows(budget, BudgetSettings(times=(10.0, 30.0)))
    texts: Any = ("No reference was given", "No stationary window")
    store(replace(found, windows=replace(budget, notes=texts)), tmp_path / FILE)
    windows = read_found(tmp_path, ()).windows
    assert windows is not None
    assert [(each.code, each["text"]) for each in windows.notes] == [(Code.STORED_TEXT, text) for text in texts]


def test_the_light_is_that_of_what_is_explained(budget: RecordedBudget):
    study = budget_of_windows(budget, BudgetSettings(times=(10.0, 20.0, 30.0)))
    sheet = Result("budget", study).page()
    assert sheet.verdict.light == ("good" if all(v.explained for v in budget.shown.verdicts) else "attention")
    assert "recorded" in sheet.verdict.sentence
    part = budget.shown
    worse = tuple(replace(v, explained=False, recorded=3.0 * v.predicted) for v in part.verdicts[:1])
    wrong = replace(budget, uncalibrated=replace(part, verdicts=(*worse, *part.verdicts[1:])))
    sheet = Result("budget", replace(study, windows=wrong)).page()
    assert sheet.verdict.light == "attention"
    assert "north are not explained: up to 3.0 times" in sheet.verdict.reason
    explained = next(panel for panel in sheet.panels if panel.key == "explained")
    kinds = {curve.name: curve for curve in explained.curves}
    assert "the stated errors of IMU and fixes do not explain it" in kinds["not explained"].text[0]
    growth = next(panel for panel in sheet.panels if panel.key == "growth")
    assert growth.curves[0].name == f"middle 90 % of {budget.shown.windows.count} windows"
    worst = next(curve for curve in growth.curves if curve.name == "up to the worst-case sum")
    assert limits_of(growth, "")[1] >= worst.y.max()  # the band is not cut
