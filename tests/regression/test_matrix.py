"""The matrix of a regression run: colours by size and significance, grey where the power is too small, history."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from peers import PeerRow, peer_matrix

from insnav.regression.baseline import Baseline
from insnav.regression.evaluate import BY_KEY, Accuracy
from insnav.regression.regress import Regression, entry
from insnav.regression.verdict import ALPHA, POWER, compare, detectable, shift
from insnav.report.html import page_html
from insnav.report.regression.page import page
from insnav.report.regression.panels import change_matrix, figures_tested, is_unclear
from insnav.result import Result
from tests.regression.conftest import THEN, with_values

KEY = "cep50_m"


def changed(result: Accuracy, factor: float, scatter: float) -> Accuracy:
    """One figure of one case changed, on average by a factor, with a scatter from drive to drive."""
    case = result.cases["sculling"]
    old = case.measured.values[KEY] + BY_KEY[KEY].floor
    error = np.linspace(-1.0, 1.0, len(old)) * scatter
    values = case.measured.values | {KEY: old * factor * np.exp(error) - BY_KEY[KEY].floor}
    return replace(result, cases=result.cases | {"sculling": with_values(case, values)})


@pytest.mark.parametrize(
    ("factor", "scatter", "tone", "text"),
    [
        (1.0, 0.0, "same", "·"),
        (1.03, 0.0005, "worse1", "+3"),
        (1.3, 0.005, "fails", "+30"),
        (0.93, 0.001, "better2", "-7"),
        (0.5, 0.01, "better3", "-50"),
        (1.04, 0.5, "unclear", "+4"),
    ],
)
def test_cells_are_coloured_by_size_and_significance(
    result: Accuracy, baseline: Baseline, factor: float, scatter: float, tone: str, text: str
):
    now = changed(result, factor, scatter)
    comparison = compare(now, baseline)
    matrix = change_matrix(now, comparison, baseline, [entry(now, comparison, THEN)])
    row = dict(matrix.rows)["sculling"]
    cell = row[matrix.columns.index(BY_KEY[KEY].label)]
    assert (cell.tone, cell.text) == (tone, text)
    versions, drives = cell.behind
    assert versions.rows[0][0] == THEN.version
    assert drives.columns == ("drive", *(str(k) for k in range(1, 7)))
    others = {each.tone for name, cells in matrix.rows for each in cells if each is not None and each is not cell}
    assert others <= {"same"}


def test_the_page_begins_with_the_matrix_and_its_cells_open(result: Accuracy, baseline: Baseline):
    now = changed(result, 1.3, 0.005)
    shown = page(Result("regression", Regression(now, baseline, THEN)))
    assert shown.verdict.light == "bad"
    assert shown.sections[0].matrix is not None
    html = page_html(replace(shown, sections=shown.sections[:1]), {})
    (cell,) = (cell for cell in shown.sections[0].matrix.cells if cell.tone == "fails")
    assert f'href="#{cell.key}"' in html
    assert f'id="{cell.key}"' in html
    assert page(Result("regression", Regression(result, baseline, THEN))).verdict.light == "good"


def test_a_change_that_counts_as_excluded_would_be_found():
    """Of changes as large as `detectable` says, the tests find as many as it says."""
    rng, metric, tests, n = np.random.default_rng(3), BY_KEY[KEY], 40, 16
    old = np.full(n, 1.0) - metric.floor
    true = 0.0
    least = [
        detectable(shift(old, old * np.exp(0.1 * rng.standard_normal(n)), metric, pieces=False), tests)
        for _ in range(300)
    ]
    true = float(np.median(least))
    found = 0
    for _ in range(400):
        new = np.exp(np.log1p(true) + 0.1 * rng.standard_normal(n)) - metric.floor
        found += shift(old, new, metric, pieces=False).p < ALPHA / tests
    print(f"changes of {100 * true:.0f} %: {found / 4:.0f} % found")
    assert abs(found / 400 - POWER) < 0.08


def test_too_few_drives_are_unclear(result: Accuracy, baseline: Baseline):
    short = {
        name: with_values(case, {k: v[:3] for k, v in case.measured.values.items()})
        for name, case in baseline.cases.items()
    }
    comparison = compare(result, replace(baseline, cases=short))
    tested = [change for change in comparison.changes if change.metric.kind != "cpu"]
    assert all(is_unclear(change, figures_tested(comparison)) for change in tested)


def test_smoothers_are_compared_with_the_smoother():
    peers = [
        PeerRow("city", "insnav", (1.0, 1.0, 2.0), (0.1, None), 2.0),
        PeerRow("city", "insnav, smoothed", (0.5, 0.5, 1.0), (0.05, None), 2.0),
        PeerRow("city", "pyins", (2.0, 1.0, 1.0), (0.1, 0.3), 1000.0),
        PeerRow("city", "gtsam, smoothed", (1.0, 0.5, None), (0.1, 0.3), 10.0),
    ]
    matrix = peer_matrix(peers)
    (row,) = (dict(zip(matrix.columns, cells, strict=True)) for _, cells in matrix.rows)
    assert (row["pyins, north"].text, row["pyins, north"].tone) == ("2", "better2")
    assert (row["pyins, down"].text, row["pyins, down"].tone) == ("0.5", "worse2")
    assert (row["gtsam, smoothed, north"].text, row["gtsam, smoothed, east"].tone) == ("2", "same")
    assert row["gtsam, smoothed, down"] is None
    assert row["pyins, heading"] is None
    assert peer_matrix(peers[:2]) is None
