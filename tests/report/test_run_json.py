"""Facts are right, complete, ready for JSON, and the same every time."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav.errors.evaluated_run import EvaluatedRun, outages
from insnav.errors.metrics import position_errors
from insnav.findings import Code, Finding
from insnav.report.run.page import run_line
from insnav.report.save import json_ready
from insnav.result import Result
from tests.report.conftest import facts_of


def leaves(value):
    if isinstance(value, dict):
        for inner in value.values():
            yield from leaves(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from leaves(inner)
    else:
        yield value


def test_facts_are_json_without_nan(facts):
    assert json.loads(json.dumps(facts, allow_nan=False)) == facts
    assert all(isinstance(leaf, str | int | float | bool | None) for leaf in leaves(facts))


def test_facts_of_the_shortest_run_are_json_too(bare):
    found = facts_of(bare)
    json.dumps(found, allow_nan=False)
    assert found["accuracy"] is None
    assert found["fixes"]["position"]["processed"] == 0
    assert found["fixes"]["position"]["nis_mean_per_axis"] is None
    assert found["outages"] == []


def test_the_same_run_gives_the_same_facts(driven, facts):
    run, _, true = driven
    again = [facts_of(run, position_errors(run.solution, true)) for _ in range(2)]
    assert json.dumps(again[0]) == json.dumps(again[1])
    assert again[0]["accuracy"]["all"] == facts["accuracy"]["all"]


def test_fixes_rejections_and_events_are_counted(driven, facts):
    run, _, _ = driven
    position = facts["fixes"]["position"]
    assert position["processed"] == len(run.innovations.time)
    assert position["rejected"] == 3
    assert position["accepted"] == position["processed"] - 3
    assert facts["fixes"]["velocity"]["rejected"] == 0
    assert facts["fixes"]["rejected_for"] == {"chi-square, position": 3}
    assert facts["events"] == {"gate.position": 3}
    # drawn from their own sd: NIS is one per axis
    assert position["nis_mean_per_axis"] == pytest.approx(1.0, abs=0.15)
    assert position["innovation_rms_m"] == pytest.approx([1.57] * 3, rel=0.15)


def test_a_fix_that_was_deweighted_counts_with_the_covariance_that_it_was_used_with(driven, facts):
    run, _, true = driven
    fixes, row, limit = run.innovations, int(np.flatnonzero(run.innovations.used_position)[5]), 21.1
    nis = np.where(np.arange(fixes.time.size) == row, 500.0, fixes.nis_position)
    event = Finding.of(Code.DEWEIGHTED_POSITION, fixes.time[row], nis=500.0, limit_nis=limit)
    changed = replace(run, innovations=replace(fixes, nis_position=nis), events=(*run.events, event))
    found, before = (each["fixes"] for each in (facts_of(changed, position_errors(run.solution, true)), facts))
    # its covariance times 500 / limit: that by which its squared innovation is the limit
    more = (500.0 / (500.0 / limit) - fixes.nis_position[row]) / 3.0 / before["position"]["accepted"]
    expected = before["position"]["nis_mean_per_axis"] + more
    assert found["position"]["nis_mean_per_axis"] == pytest.approx(expected, rel=1e-9)
    assert found["velocity"] == before["velocity"]


def test_distance_and_time_in_motion_are_those_of_the_truth(driven, facts):
    _, _, true = driven
    walked = np.trapezoid(np.linalg.norm(true.v_n, axis=1), true.time)
    assert facts["solution"]["distance_m"] == pytest.approx(walked, rel=0.02)
    assert facts["solution"]["moving_s"] == pytest.approx(300.0, abs=5.0)
    assert facts["solution"]["rate_hz"] == pytest.approx(5.0)
    assert facts["accuracy"]["static"]["n"] + facts["accuracy"]["moving"]["n"] == facts["accuracy"]["all"]["n"]


def test_an_unknown_gyro_bias_sd_is_none(driven):
    run, _, _ = driven
    never_at_rest = replace(run.alignment, gyro_bias_sd=np.full(3, np.inf), static=None)
    found = facts_of(replace(run, alignment=never_at_rest))
    assert found["alignment"]["gyro_bias_sd_deg_h"] == [None] * 3
    assert found["alignment"]["static_s"] is None


def test_sensor_errors_are_in_the_units_of_the_field(driven):
    run, _, _ = driven
    value = np.ones((1, 12))
    value[:, 6:] = np.nan  # scale factors not estimated
    errors = replace(run.sensor_errors, time=np.array([1.0]), value=value, sd=value)
    found = facts_of(replace(run, sensor_errors=errors))["sensor_errors"]
    assert found["gyro_bias_deg_h"] == pytest.approx([206264.806] * 3)
    assert found["accel_bias_mg"] == pytest.approx([101.97162] * 3)
    assert "gyro_scale_ppm" not in found


def test_outages_are_found_inside_and_at_both_ends(driven):
    run, _, _ = driven
    assert outages(run) == [(400.0, 430.0, 0)]
    late = run.innovations.time >= 50.0
    early = run.innovations.time <= 550.0
    cut = replace(run.innovations, used_position=run.innovations.used_position & late & early)
    assert outages(replace(run, innovations=cut)) == [(0.0, 50.0, 50), (400.0, 430.0, 0), (550.0, 600.0, 50)]
    none = replace(run.innovations, used_position=np.zeros_like(late))
    assert outages(replace(run, innovations=none)) == [(0.0, 600.0, len(late))]


def test_a_time_with_fixes_that_were_rejected_is_no_outage(driven):
    run, gps, _ = driven
    inside = (run.innovations.time > 100.0) & (run.innovations.time < 110.0)
    lost = replace(run.innovations, used_position=run.innovations.used_position & ~inside)
    found = Result("run", EvaluatedRun(replace(run, innovations=lost), gps))
    assert "; outage of 30.0 s; fixes rejected for 10.0 s" in run_line(found)


def test_everything_a_configuration_may_hold_becomes_json():
    value = {
        "path": Path("a/b"),
        "kind": Code.FILTER_RESET,
        "array": np.array([[1.0, np.nan], [np.inf, 2.0]]),
        "scalar": np.float64(np.nan),
        "flag": np.bool_(True),
        "set": {"b", "a"},
        3: (1, None),
    }
    assert json_ready(value) == {
        "path": "a/b",
        "kind": "filter.reset",
        "array": [[1.0, None], [None, 2.0]],
        "scalar": None,
        "flag": True,
        "set": ["a", "b"],
        "3": [1, None],
    }
