"""The summary fits a screen and says what matters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav.errors.evaluated_run import EvaluatedRun
from insnav.quantity import Quantity, quantity_of
from insnav.report.numbers import number
from insnav.report.page import Section, cell, section_tables
from insnav.report.run.summary import LINES, WIDTH, summary_lines
from insnav.report.run.warnings import run_warnings
from tests.report.conftest import facts_of


def test_one_screen_with_everything_that_was_asked(facts):
    lines = summary_lines({**facts, "files": {"solution.csv": {}, "report.html": {}}}, Path("out/drive"))
    assert len(lines) <= LINES == 46
    assert max(map(len, lines)) <= WIDTH == 100
    text = "\n".join(lines)
    for words in (
        *(
            "36000 of 36001 rows",
            "2 gaps, longest 0.31 s",
            "FRD",
            "consumer: nearest to",
            "delay 0.050 ± 0.010 s",
        ),
        *("level: levelling at rest; heading: course of the GPS", "3 by chi-square, position"),
        *("1, the longest 30.0 s", "epochs of ref.csv", "static", "moving", "RMS", "95 %", "max", "CEP50"),
        *("R95", "inside 3 sd", "heading is not observable", "out/drive: report.html, solution.csv"),
    ):
        assert words in text


def test_a_notebook_gets_the_same_summary(navigated, facts):
    assert navigated.summary() == "\n".join(summary_lines(facts))
    shown = navigated._repr_html_()
    assert "horizontal [m]" in shown
    assert "Options" not in shown


def test_the_figures_of_the_table_are_those_of_the_facts(facts):
    row = next(line for line in summary_lines(facts) if line.strip().startswith("horizontal [m]"))
    expected = [
        number(facts["accuracy"][part]["horizontal_m"][name])
        for part in ("all", "static", "moving")
        for name in ("rms", "p95", "max")
    ]
    assert row.split()[2:] == expected


def test_a_crowded_and_hostile_run_still_fits(facts):
    crowd = {
        **facts,
        "notes": [f"\x1b[31mwarning {i} " + "x" * 300 for i in range(50)],
        "input": {f"file{i}": {"path": "p" * 200, "n_rows": 10**9} for i in range(3)},
    }
    lines = summary_lines(crowd, Path("o" * 150))
    assert len(lines) <= LINES
    assert max(map(len, lines)) <= WIDTH
    assert not any("\x1b" in line for line in lines)
    assert any("46 more notes" in line for line in lines)
    assert any(line.startswith("files") for line in lines[-2:])


def test_many_rejected_fixes_are_pointed_out_and_few_are_not(driven, facts):
    assert "many fixes" not in "\n".join(summary_lines(facts))
    run, _, _ = driven
    every_other = np.arange(len(run.innovations.time)) % 2 == 0
    bad = replace(run, innovations=replace(run.innovations, used_position=every_other))
    text = "\n".join(summary_lines(facts_of(bad)))
    assert "warning     many fixes were rejected, 50 % of position:" in text


def test_a_scale_factor_that_no_sensor_has_is_pointed_out(driven):
    run, _, _ = driven
    value, sd = run.sensor_errors.value.copy(), run.sensor_errors.sd.copy()
    value[-1, 6:9], sd[-1, 6:9] = (0.17, 0.17, 0.01), (0.03, 0.1, 0.001)
    bad = replace(run, sensor_errors=replace(run.sensor_errors, value=value, sd=sd))
    (said,) = [line for line in run_warnings(EvaluatedRun(bad)) if "scale factor" in line]
    assert "larger than any sensor has: gyro x +17 %; the drive" in said
    assert not any("scale factor" in line for line in run_warnings(EvaluatedRun(run)))


def test_the_shortest_run_is_summed_up(bare):
    text = "\n".join(summary_lines(facts_of(bare)))
    assert "no reference was given" in text
    assert "fixes       none" in text
    assert "nan" not in text.lower().split()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.0, "0.00"),
        (1.2345, "1.23"),
        (12345.6, "12300"),
        (0.00012, "0.000120"),
        (-4.0781e-05, "-0.0000408"),
        (-99.96, "-100"),
    ],
)
def test_numbers_have_three_digits_and_no_exponent(value, text):
    assert number(value) == text


def test_units_of_keys_are_put_in_brackets():
    for key, text in (
        ("gyro_bias_deg_h", "gyro bias [deg/h]"),
        ("max_speed_m_s", "max speed [m/s]"),
        ("start_s", "start [s]"),
        ("axes", "axes"),
        ("random_walk_m_s_sqrt_h", "random walk [m/s/√h]"),
    ):
        ((row,),) = (table.rows for table in section_tables(Section("", items=(quantity_of(key, 1.0),))))
        assert row == (text, "1.00")
    assert cell(Quantity("any", ("1", "a\x1b[0m"))) == "1, a"
    assert cell(Quantity("any", {"a": True})) == "a yes"
