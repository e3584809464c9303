"""Tables, sentences, figures and facts of recorded windows say what was found."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from insnav.errors.budget.from_windows import RecordedBudget, WindowSettings, recorded_budget
from insnav.errors.diagnosis.simulated_replica import Replicas
from insnav.errors.outage.statistics import COMPONENTS
from insnav.report.budget.windows import (
    recorded_assumptions,
    recorded_pictures,
    recorded_sentences,
    recorded_sheet,
    recorded_tables,
    recorded_warnings,
)
from insnav.report.budget.windows_quantities import recorded_facts
from insnav.report.sheet import sheet_text
from insnav.simulate.truth_from_track import Residual
from tests.errors.outage import drives


@pytest.fixture(scope="module")
def budget() -> RecordedBudget:
    settings = WindowSettings(length=30.0, spacing=20.0, uncalibrated=True)
    return recorded_budget(drives.injected(), drives.SPEC, None, settings)


def with_twins(budget: RecordedBudget, factor: float) -> RecordedBudget:
    part = budget.calibrated
    recorded = part.growth.total_rms
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
    tables = recorded_tables(budget)
    titles = [table.title for table in tables]
    assert len(set(titles)) == len(titles) == 10
    first = tables[0]
    assert first.columns[1:] == ("10 s", "20 s", "30 s")
    assert [row[0] for row in first.rows] == list(COMPONENTS)
    rms, high, largest = first.rows[0][3].split(" / ")
    assert float(rms) == pytest.approx(budget.calibrated.growth.rms[-1, 0], rel=0.01)
    assert float(rms) <= float(largest)
    assert float(high) <= float(largest)
    for table in tables:
        assert all(len(row) == len(table.columns) for row in table.rows)
        assert "nan" not in " ".join(text for row in table.rows for text in row)


def test_sensors_as_turned_on_are_told_in_field_units(budget: RecordedBudget):
    (table,) = [t for t in recorded_tables(budget) if t.title.startswith("Constant") and "turned on" in t.title]
    accel, gyro = ([float(row[i].split(" ± ")[0]) for row in table.rows] for i in (1, 2))
    np.testing.assert_allclose(accel, drives.SIGNS, rtol=0.1)
    np.testing.assert_allclose(gyro[:2], 10.0 * drives.SIGNS[:2], rtol=0.1)


def test_sentences_explain(budget: RecordedBudget):
    lines = recorded_sentences(budget)
    text = " ".join(lines)
    assert "predicted" in text
    assert "explained" in text
    assert "of tilt or" in text
    assert "bias and tilt cannot be told apart in a straight window" in text
    assert "times that of the prediction" in text
    assert "do not overlap" in text


@pytest.mark.parametrize(("factor", "words"), [(1.0, "describes this recording"), (0.3, "worse"), (4.0, "better")])
def test_twins_are_said_to_agree_or_not(budget: RecordedBudget, factor: float, words: str):
    made = with_twins(budget, factor)
    (line,) = [text for text in recorded_sentences(made) if "simulated twins" in text]
    assert words in line
    warned = any("twins" in text for text in recorded_warnings(made))
    assert warned == (factor != 1.0)


def test_what_is_not_explained_is_a_warning(budget: RecordedBudget):
    part = budget.calibrated
    wrong = tuple(replace(each, explained=False) for each in part.verdicts[:1])
    found = recorded_warnings(replace(budget, calibrated=replace(part, verdicts=wrong)))
    assert any("north is larger than predicted" in text for text in found)


def test_a_start_that_is_not_independent_is_a_warning(budget: RecordedBudget):
    noted = replace(budget, notes=("Not independent: so and so", "else"))
    assert recorded_warnings(noted)[0].startswith("Not independent")
    assert "else" in recorded_assumptions(noted)


def test_facts_are_json_with_units(budget: RecordedBudget):
    facts = json.loads(json.dumps(recorded_facts(with_twins(budget, 1.0)), allow_nan=False))
    calibrated = facts["calibrated"]
    assert calibrated["windows"] == budget.calibrated.windows.count
    assert calibrated["rms_m"]["north"][-1] == pytest.approx(budget.calibrated.growth.rms[-1, 0])
    assert calibrated["twins"]["inside_band"] is True
    assert facts["raw"]["sensors"]["accel_bias_mg"] == pytest.approx(list(drives.SIGNS), rel=0.1)
    assert facts["raw"]["by_motion"]["static"] is None
    assert facts["raw"]["diagnosis"]["north"]["acceleration"]["filter_sd_mg"] == pytest.approx(1.0, rel=0.3)


def test_sheet_and_figures(budget: RecordedBudget):
    made = with_twins(budget, 1.0)
    text = sheet_text(recorded_sheet(made, "drive.csv"))
    assert "nan" not in text
    pictures = recorded_pictures(made)
    assert len({picture.name for picture in pictures}) == len(pictures) == 6
    for picture in pictures:
        for axes in picture.figure.axes:
            assert axes.get_ylabel().endswith("]")
            assert np.isfinite(axes.get_ylim()).all()
