"""Page and facts of an error budget."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes

from insnav.errors.budget.error_budget import Budget, RecordedColumn, budget
from insnav.errors.budget.from_windows import BudgetStudy
from insnav.errors.budget.sources import at_rest, families, sources_of
from insnav.findings import Code, Severity, of_code
from insnav.imu import load_imu
from insnav.messages import sentence
from insnav.report.budget.page import assumptions, page, warnings
from insnav.report.budget.quantities import (
    contributions_section,
    effect,
    estimates_section,
    growth,
    horizontal,
    positions_section,
    ranked,
    saved,
    shares,
    size,
)
from insnav.report.figures import drawing
from insnav.report.page import section_tables
from insnav.report.save import page_facts
from insnav.report.style import number
from insnav.report.terminal import page_text
from insnav.result import Result
from insnav.units import UNITS
from tests.errors.budget.imus import plain, whole


@pytest.fixture(scope="module")
def found() -> Budget:
    return budget(plain(), at_rest(20.0), (5.0, 10.0, 20.0), runs=30)


def page_of(found: Budget):
    return page(Result("budget", BudgetStudy(found)))


def drawn(found: Budget, name: str) -> Axes:
    with drawing():
        return next(each for each in page_of(found).figures if each.name == name).draw().axes[0]


def cells(table, name: str) -> dict[str, str]:
    row = next(row for row in table.rows if row[0] == name)
    return dict(zip(table.columns, row, strict=True))


def test_the_frame_is_of_numbers_with_their_units(found):
    frame = Result("budget", BudgetStudy(found)).to_frame().set_index("source")
    assert frame["share_percent"].sum() == pytest.approx(100.0)
    bias = max(source.sd for source in found.sources if source.family == "accel bias")
    assert frame.loc["accel bias", "size_largest"] * UNITS[frame.loc["accel bias", "size_unit"]][1] == pytest.approx(
        bias
    )
    numbers = ("analytic_m", "covariance_m", "simulated_m", "down_m", "halved_saves_m", "size_least", "size_largest")
    assert all(frame[name].dtype == np.float64 for name in numbers)


def test_columns_are_the_errors_at_the_times(found):
    table = section_tables(positions_section(found))[0]
    assert [row[0] for row in table.rows] == ["5", "10", "20"]
    assert len(table.columns) == 1 + 4 * 3
    at = found.chosen[2]
    row = cells(table, "20")
    assert float(row["covar. N"]) == pytest.approx(found.covariance.total[at, 0], rel=5e-3)
    assert float(row["analytic E"]) == pytest.approx(found.analytic.total[at, 1], rel=5e-3)
    assert float(row["simul. D"]) == pytest.approx(found.simulated.total[at, 2], rel=5e-3)
    assert float(row["worst N"]) > float(row["covar. N"])


def test_sources_are_ranked_and_sum_up(found):
    table = section_tables(contributions_section(found))[0]
    values = [float(row[table.columns.index("covariance")]) for row in table.rows[:-2]]
    assert values == sorted(values, reverse=True)
    assert float(cells(table, "together (RSS)")["covariance"]) == pytest.approx(
        np.sqrt(np.sum(np.square(values))), rel=0.01
    )
    assert shares(found).sum() == pytest.approx(1.0)
    percent = [float(row[-2].rstrip(" %")) for row in table.rows[:-2]]
    assert sum(percent) == pytest.approx(100.0, abs=0.06 * len(percent))
    assert {row[0] for row in table.rows[:-2]} == set(found.families)


def test_every_family_has_words_a_unit_and_a_law():
    sources = sources_of(whole(), 1e-5)
    every = replace(budget(plain(), at_rest(5.0), (5.0,)), sources=sources)
    for family in families(sources):
        assert effect(family)
        assert size(every, family).split()[0][0].isdigit()
        assert growth(every, family)
    assert size(every, "gyro bias") == "1.6 to 2.4 deg/h"
    assert size(every, "initial tilt") == "0.02 deg"
    laws = {"gyro bias": "t³", "accel bias": "t²", "gyro white noise": "t²·⁵", "accel white noise": "t¹·⁵"}
    laws |= {"gyro rate random walk": "t³·⁵", "initial velocity": "t", "initial tilt": "t²", "gyro bias ramp": "t⁴"}
    assert {family: growth(every, family) for family in laws} == laws


def test_facts_are_complete_and_json(found):
    facts = json.loads(json.dumps(page_facts(page_of(found))))
    assert [entry["time_s"] for entry in facts["budget"]] == pytest.approx([5.0, 10.0, 20.0])
    last = facts["budget"][-1]
    assert last["covariance"]["position_m"] == pytest.approx(list(found.covariance.total[found.chosen[-1], :3]))
    assert set(last["simulated"]["sources"]) == set(found.families)
    assert len(last["covariance"]["worst_position_m"]) == 3
    assert last["covariance"]["worst_horizontal_m"] > last["covariance"]["horizontal_m"]
    assert facts["runs"]["count"] == 30
    assert len(facts["sources"]) == 95
    assert facts["recorded"] is None
    assert facts["short_form_error"]["bias_and_tilt"] == pytest.approx(-5.1e-5, rel=0.05)


def test_page_shows_curves_tables_and_assumptions(found):
    sheet = page_of(found)
    written = page_text(sheet, 108)
    for family in found.families:
        assert family in written
    (short,) = of_code(assumptions(found), Code.BUDGET_SHORT_FORMS)
    assert " ".join(sentence(short).split()) in " ".join(written.split())
    linear, growth_axes, bars = (drawn(found, name) for name in ("growth", "sources", "contributions"))
    assert bars.get_yticklabels()[0].get_text() == found.families[ranked(found)[0]]
    labels = [text.get_text() for text in linear.get_legend().get_texts()]
    assert labels == ["up to the worst-case sum", "covariance, 1 sd", "analytic", "simulated, 30 runs"]
    assert (growth_axes.get_xscale(), growth_axes.get_yscale()) == ("log", "log")
    assert {"t", "t²", "t³"} <= {text.get_text() for text in growth_axes.texts}
    shown = page_text(sheet)
    assert "1 if the covariance is true" in shown


def test_the_first_sentence_has_all_four_ways_and_the_largest_source(found):
    whole = float(horizontal(found.covariance.total[found.chosen[-1]]))
    said = page_of(found).verdict
    assert said.light == "good"
    assert said.sentence.startswith(f"After 20 s without GPS: {number(whole)} m horizontal (1 sd) — analytic ")
    assert size(found, found.families[ranked(found)[0]]) in said.sentence
    assert "simulated" in said.sentence
    assert "recorded" not in said.sentence
    predicted = page_of(replace(found, simulated=None)).verdict
    assert (predicted.light, "simulated" in predicted.sentence) == ("unknown", False)
    assert (
        page_of(replace(found, simulated=replace(found.simulated, nees=2.0 * found.simulated.nees))).verdict.light
        == "bad"
    )
    table = section_tables(estimates_section(found))[0]
    assert [row[0] for row in table.rows] == ["5 s", "10 s", "20 s"]
    assert "…" in cells(table, "20 s")["simulated [m]"]


def test_what_halving_saves_is_what_a_better_imu_saves(found):
    """The saving by the shares of the variance, and by the budget of an IMU that is half as bad."""
    names = {"gyro bias": "gyro", "accel bias": "accel"}
    whole = float(horizontal(found.covariance.total[found.chosen[-1]]))
    for family, sensor in names.items():
        spec = plain()
        better = replace(spec, **{sensor: replace(getattr(spec, sensor), bias=0.5 * getattr(spec, sensor).bias)})
        less = budget(better, at_rest(20.0), (5.0, 10.0, 20.0))
        wanted = whole - float(horizontal(less.covariance.total[less.chosen[-1]]))
        assert saved(found)[found.families.index(family)] == pytest.approx(wanted, rel=1e-6)


def test_sources_of_the_waterfall_say_where_they_come_from(found):
    panels = {each.key: each for each in page_of(found).panels}
    assert list(panels) == ["growth", "contributions", "sources"]
    bars = [curve for curve in panels["contributions"].curves if curve.kind == "bars"]
    width = sum(float(np.sum(curve.x - curve.low)) for curve in bars)
    assert width == pytest.approx(100.0)
    told = [text for curve in bars for text in curve.text]
    first = next(text for text in told if text.startswith(found.families[ranked(found)[0]]))
    for words in ("IMU model plain", "% of the variance", "grows with", "Half of it"):
        assert words in first


def test_a_recorded_column_has_its_place(found):
    size = np.array([[1.5, 1.0, np.nan, 1.8], [6.25, 1.0, 1.0, 6.33]])
    recorded = RecordedColumn(np.array([10.0, 20.0]), size, 0.7 * size, 1.4 * size, np.ones((2, 4)), 12, "a drive")
    joined = replace(found, recorded=recorded)
    table = section_tables(positions_section(joined))[0]
    assert cells(table, "20")["rec. N"] == "6.25"
    assert cells(table, "5")["rec. N"] == "–"
    labels = [t.get_text() for t in drawn(joined, "growth").get_legend().get_texts()]
    assert "recorded, 12 windows" in labels
    assert page_facts(page_of(joined))["recorded"]["windows"] == 12


def test_what_is_missing_or_too_large_is_said(found):
    assert warnings(found) == ()
    bare = replace(found, absent=("gyro.bias",), ignored=("gyro quantisation",))
    absent, ignored = warnings(bare)
    assert (absent.code, absent["terms"], absent.severity) == (Code.BUDGET_ABSENT, ("gyro.bias",), Severity.WARNING)
    assert (ignored.code, ignored["terms"]) == (Code.BUDGET_IGNORED, ("gyro quantisation",))
    wrong = replace(found, simulated=replace(found.simulated, nees=2.0 * found.simulated.nees))
    (mismatch,) = warnings(wrong)
    assert mismatch.code is Code.BUDGET_SIMULATED_MISMATCH
    assert mismatch["nees"] == pytest.approx(2.0, abs=0.5)
    shown = " ".join(page_text(page_of(bare), 108).split())
    for warning in (absent, ignored):
        assert " ".join(sentence(warning).split()) in shown
    consumer = budget(load_imu("consumer"), at_rest(60.0), (60.0,))
    (steep,) = of_code(warnings(consumer), Code.BUDGET_NONLINEAR)
    assert steep["attitude_rad"] == consumer.covariance.total[consumer.chosen[-1], 6:].max()


def test_beyond_the_linear_model_every_figure_is_the_simulated_one():
    steep = budget(load_imu("consumer"), at_rest(60.0), (60.0,), runs=20)
    down = float(steep.simulated.total[-1, 2])
    assert down > 2.0 * steep.covariance.total[-1, 2]
    laid_out = page_of(steep)
    shown = {each.key: each.value for each in laid_out.merits}
    assert (shown["down"], shown["after_60_s"]) == (down, float(horizontal(steep.simulated.total[-1])))
    assert cells(section_tables(contributions_section(steep))[0], "together (RSS)")["down"] == number(down)
    assert f"down: {number(down)} m" in laid_out.summary[0]


def test_a_held_vertical_is_said():
    held = budget(plain(), at_rest(10.0), (10.0,), hold=True)
    sheet = page_of(held)
    assert "down: held to the reference" in sheet.summary[0]
    assert any(of_code(assumptions(held), Code.BUDGET_VERTICAL_HELD))
    assert not any(of_code(assumptions(held), Code.BUDGET_VERTICAL_FREE))
    assert sheet.assumptions == tuple(map(sentence, assumptions(held)))
    assert {each.severity for each in assumptions(held)} == {Severity.ASSUMPTION}
