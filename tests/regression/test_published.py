"""Published outage figures: read, explained, summed up as papers do, and the factor that reports quote."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from peers import (
    Case,
    Compared,
    compare_published,
    field_factor,
    read_cases,
    recorded_ratios,
    statistic,
    write_published,
)

from insnav.errors.requirement.study import SPAN, TYPICAL
from tests.regression.conftest import THEN

REPORT = Path(__file__).parents[2] / "reports" / "published.md"
ERRORS = [np.array([0.0, 1.0, 3.0, 2.0]), np.array([0.0, 4.0, 1.0, 1.0])]


def test_eight_cases_and_more_each_with_its_reason() -> None:
    cases = read_cases()
    assert len(cases) >= 8
    assert len({case.where for case in cases}) >= 4
    assert all(len(case.reason) > 10 and case.value > 0.0 for case in cases)


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("RMS at the end", math.sqrt(2.5)),
        ("RMS of maxima", math.sqrt(12.5)),
        ("mean at the end", 1.5),
        ("maximum", 2.0),
    ],
)
def test_statistics_are_those_of_the_papers(kind, expected: float) -> None:
    assert statistic(kind, ERRORS) == pytest.approx(expected)


def test_the_field_factor_of_two_tests_by_hand(tmp_path: Path) -> None:
    case = read_cases()[0].model_copy(update={"value": 2.0})
    compared = [Compared(case, (), 1.0, (0.5, 2.0), 10)]
    found = field_factor(compared, {"drive": 8.0})
    assert found.typical == pytest.approx(4.0)
    sd, quantile = math.log(4.0) / math.sqrt(2.0), 12.7062047  # Student's t, one degree of freedom
    assert math.log(found.interval[1] / 4.0) == pytest.approx(quantile * sd / math.sqrt(2.0), rel=1e-6)
    assert math.log(found.span[1] / 4.0) == pytest.approx(quantile * sd * math.sqrt(1.5), rel=1e-6)
    write_published(tmp_path, compared, {"drive": np.array([[3.0, 128.0, 2.0]])}, THEN)
    text = (tmp_path / REPORT.name).read_text()
    assert "predicted error: **4.00**" in text
    assert "\n| drive | 8.00 |\n" in text


def test_other_figures_of_a_test_do_not_count_twice() -> None:
    first, other = read_cases()[0], read_cases()[3]
    assert not other.independent
    pair = [Compared(each, (), 1.0, (0.5, 2.0), 10) for each in (first, other)]
    assert set(field_factor(pair, {"a": 1.0}).ratios) == {first.source, "a"}


def test_recorded_ratios_leave_out_drives_without_a_minute() -> None:
    growth = {"a": np.array([[3.0, 8.0, 2.0]]), "b": np.zeros((1, 3))}
    assert recorded_ratios(growth) == {"a": 2.0}


def test_the_factor_that_reports_quote_is_that_of_the_table() -> None:
    text = REPORT.read_text()
    typical = re.search(r"error: \*\*([\d.]+)\*\*", text)
    span = re.search(r"\*\*([\d.]+) to ([\d.]+)\*\*", text)
    assert typical
    assert span
    assert float(typical[1]) == pytest.approx(TYPICAL, abs=0.05)
    assert tuple(map(float, span.groups())) == pytest.approx(SPAN, rel=0.05)
    assert text.count("\n| ") >= 8 + 2 + len(read_cases())


def test_a_replica_of_the_calibrated_array_is_of_its_size() -> None:
    case: Case = next(each for each in read_cases() if each.source.endswith("16, calibrated"))
    found = compare_published([case], seeds=1)[0]
    assert found.outages > 15
    assert 0.6 < found.ratio < 4.0
