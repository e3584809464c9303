"""The summary fits a few lines and says what matters."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from insnav.errors.evaluated_run import EvaluatedRun
from insnav.errors.metrics import position_errors
from insnav.filter.noise_estimate import NoiseFigure
from insnav.findings import Code, untyped_event
from insnav.plain_text import moment
from insnav.quantity import Quantity, quantity_of
from insnav.report.numbers import number
from insnav.report.page import Section, Verdict, cell, section_tables
from insnav.report.run.verdict import brief_lines, run_merits
from insnav.report.run.warnings import run_assumptions, run_warnings
from insnav.report.series import Clock
from insnav.report.terminal import WIDTH
from insnav.sample_statistics import rms
from tests.report.conftest import result_of

LINES = 20  # of title 2, verdict 2, table 7, warnings and assumptions; the command adds the files


def test_a_few_lines_say_what_matters(navigated):
    lines = navigated.summary().splitlines()
    assert len(lines) <= LINES
    assert max(map(len, lines)) <= WIDTH == 80
    text = "\n".join(lines)
    for words in ("drive.csv: 10.0 min", "GPS outage of 30.0 s", "horizontal error RMS [m]", "filtered"):
        assert words in text
    row = next(line for line in lines if line.strip().startswith("horizontal error RMS [m]"))
    assert row.split()[-1] == number(rms(navigated.found.errors.horizontal))


def test_errors_far_within_what_is_stated_are_said_so(navigated):
    found = navigated.found
    assert navigated.page().verdict.reason.endswith("within what is stated")
    careful = replace(found.errors, sd=10.0 * found.errors.sd)
    far = replace(found, errors=careful, smoothed_errors=None)
    assert "times their size" in replace(navigated, found=far).page().verdict.reason
    (stated,) = [each for each in run_merits(far, "filtered") if each.key == "horizontal_sd"]
    assert stated.value == pytest.approx(10.0 * float(np.sqrt(np.mean(np.sum(found.errors.sd[:, :2] ** 2, axis=1)))))


def test_times_in_a_text_stand_on_the_axis_of_the_plots_and_lengths_as_they_are():
    short, long = (Clock.of(np.array([1000.0, 1000.0 + length])) for length in (600.0, 1800.0))
    text = f"rejected for 30.0 s at {moment(1100.0)} and {moment(1300.04, 1330.0)}, off by 1.9e+02 m"
    assert short.tell(text) == "rejected for 30.0 s at 100.0 s and 300.0 to 330.0 s, off by 190 m"
    assert long.tell(text) == "rejected for 30.0 s at 1.67 min and 5.00 to 5.50 min, off by 190 m"


def test_warnings_count_from_the_start_of_the_run(driven):
    run, gps, _ = driven
    later = replace(run, solution=replace(run.solution, time=run.solution.time + 1000.0))
    lost = untyped_event(1012.0, Code.IMU_STUCK, 3.0, np.nan, "s", "gyro x stuck: left out")
    (said,) = [text for text in run_warnings(EvaluatedRun(replace(later, events=(lost,)), gps)) if "stuck" in text]
    assert "first at 12.0 s" in said
    assert said.endswith("(times in warnings are from the start)")
    more = (lost, replace(lost, action="gyro y stuck: left out"))
    several = run_warnings(EvaluatedRun(replace(later, events=more), gps))
    assert sum("from the start" in text for text in several) == 1  # the first says it for all
    early = run_warnings(EvaluatedRun(replace(run, events=(replace(lost, time=12.0),)), gps))
    assert not any("from the start" in text for text in early)  # a record that begins at zero


@pytest.mark.parametrize(("share", "said"), [(0.2, False), (0.5, True)])
def test_fixes_before_a_late_start_are_pointed_out_where_they_are_many(driven, share, said):
    run, gps, _ = driven
    used, begin = run.innovations.time.size, float(run.solution.time[0])
    early = round(share / (1.0 - share) * used)
    outside = untyped_event(begin, Code.GPS_OUTSIDE, float(early), np.nan, "fixes", "not used: before the start")
    after = replace(outside, time=begin + 600.0, value=9.0 * used)
    found = run_warnings(EvaluatedRun(replace(run, events=(outside, after)), gps))
    assert any(f"the first {early} of {early + used} fixes are not used" in text for text in found) == said


def test_a_constant_difference_is_named_as_what_it_is(driven, navigated):
    """A base station 5 sd lower, and a few epochs that are far off."""
    run, gps, _ = driven
    errors = navigated.found.errors
    lower = errors.position + np.array([0.0, 0.0, 5.0 * float(np.median(errors.sd[:, 2]))])
    (said,) = [text for text in run_warnings(EvaluatedRun(run, gps, replace(errors, position=lower))) if "3 sd" in text]
    assert f"{np.median(lower[:, 2]):+.3f} m down makes most of them" in said
    wild = errors.position * np.where(np.arange(len(errors.time)) % 10, 0.01, 40.0)[:, None]
    (said,) = [text for text in run_warnings(EvaluatedRun(run, gps, replace(errors, position=wild))) if "3 sd" in text]
    assert "constant" not in said


def test_a_few_wild_epochs_do_not_hide_how_good_the_rest_is(driven, navigated):
    run, gps, _ = driven
    errors = navigated.found.errors
    wild = errors.position * np.where(np.arange(len(errors.time)) % 50, 1.0, 300.0)[:, None]
    worse = replace(navigated, found=EvaluatedRun(run, gps, replace(errors, position=wild)))
    most = number(float(np.percentile(np.hypot(*wild[:, :2].T), 95.0)))
    assert f"RMS filtered (95 % within {most} m)" in worse.page().verdict.sentence
    assert "95 % within" not in navigated.page().verdict.sentence


def test_a_notebook_gets_the_tables(navigated):
    shown = navigated._repr_html_()
    assert "horizontal [m]" in shown
    assert "Options" not in shown


def test_a_crowded_and_hostile_run_still_fits(navigated):
    page = navigated.page()
    noise = tuple(f"\x1b[31mwarning {i} " + "x" * 300 for i in range(50))
    crowd = replace(page, title="p" * 200, warnings=noise, assumptions=noise)
    lines = brief_lines(crowd, navigated.found)
    assert len(lines) <= LINES
    assert max(map(len, lines)) <= WIDTH
    assert not any("\x1b" in line for line in lines)
    assert any("of 50)" in line for line in lines)


def test_the_light_follows_the_harm(driven, navigated):
    assert navigated.page().verdict.light == "good"
    run, gps, true = driven
    few = replace(run, solution=replace(run.solution, sd=0.1 * run.solution.sd))
    bad = replace(navigated, found=EvaluatedRun(few, gps, position_errors(few.solution, true))).page()
    assert bad.verdict.light == "bad"
    assert "does not hold" in bad.verdict.sentence
    assert bad.warnings
    errors = navigated.found.errors
    part = replace(navigated, found=EvaluatedRun(run, gps, errors.rows(slice(len(errors.time) // 4)))).page().verdict
    assert part.light == "unknown"
    assert "covers 25 % of the drive" in part.reason
    alone = replace(navigated, found=EvaluatedRun(run, gps)).page().verdict
    assert alone.light == "unknown"
    assert "no reference" in alone.reason
    assert "not known" in alone.sentence
    fixes = run.innovations
    wild = replace(fixes, nis_position=4.0 * fixes.nis_position, nis_velocity=4.0 * fixes.nis_velocity)
    doubtful = replace(navigated, found=EvaluatedRun(replace(run, innovations=wild), gps)).page().verdict
    assert doubtful.light == "attention"
    assert "scatter more" in doubtful.reason


def test_a_reference_that_is_late_does_not_condemn_the_solution(driven, navigated):
    run, gps, true = driven
    late = replace(true, time=true.time + 1.0)
    event = untyped_event(run.solution.time[0], Code.REF_CONTRADICTION, 1.0, 0.03, "s", "its clock is ahead")
    found = EvaluatedRun(run, gps, position_errors(run.solution, late))
    assert replace(navigated, found=found).page().verdict.light == "bad"
    said = replace(navigated, found=replace(found, run=replace(run, events=(*run.events, event)))).page()
    right, wrong = (number(rms(each.horizontal)) for each in (position_errors(run.solution, true), found.errors))
    assert said.verdict.light == "attention"
    assert said.verdict.reason.startswith("the clock of the reference is off, not the solution")
    for words in (f"{right} m RMS", f"with -1.00 s added to the times of the reference, {wrong} m without"):
        assert words in said.verdict.reason
        assert words.split(" m")[0] in said.verdict.sentence
    shown = replace(run, events=(*run.events, event), gps_delay=-0.7, gps_delay_sd=0.1)  # which explains it
    of_fixes = replace(navigated, found=replace(found, run=shown)).page().verdict.reason
    assert of_fixes.startswith("the solution has the time of the fixes, not that of samples and reference")
    fixes = replace(run.innovations, nis_position=4.0 * run.innovations.nis_position)  # which contradict it
    wild = replace(run, events=(*run.events, event), innovations=fixes)
    assert not replace(navigated, found=replace(found, run=wild)).page().verdict.reason.startswith("the clock")


def test_a_lever_arm_of_zero_is_an_assumption_unless_it_was_given(driven, navigated):
    run, gps, _ = driven
    nothing = replace(run, lever_b=np.zeros(3), lever_sd=np.zeros(3))
    said = replace(navigated, found=EvaluatedRun(nothing, gps), options={}).page().assumptions[0]
    assert said.startswith("lever arm zero")
    given = replace(navigated, found=EvaluatedRun(nothing, gps), options={"lever_arm": "0,0,0"}).page().assumptions
    assert not any("lever arm" in text for text in given)


def test_what_was_not_given_is_said_as_the_drive_shows_it(driven, navigated):
    run, gps, _ = driven
    arm, sd = np.array([1.0, 0.0, -0.5]), np.array([0.1, 0.02, 0.003])
    shown = replace(run, gps_delay=-0.069, gps_delay_sd=0.004, lever_b=arm, lever_sd=sd)
    page = replace(
        navigated.page(), notes=("the clock of the IMU is 292 ppm fast against GPS time, corrected", "other")
    )
    (said,) = [line for line in brief_lines(page, EvaluatedRun(shown, gps), None) if line.startswith("found")]
    assert (
        "the fixes are 0.069 ± 0.004 s early; lever arm x, y, z 1.00 ± 0.10, 0.00 ± 0.02, -0.50 ± 0.01 m; the " in said
    )
    assert said.endswith("292 ppm fast against GPS time, corrected")
    bad = replace(page, verdict=Verdict("bad", "the errors are larger than stated", ""))
    assert any(line.startswith("found (doubtful") for line in brief_lines(bad, EvaluatedRun(shown, gps), None))
    wrong = replace(shown, events=(*shown.events, untyped_event(0.0, Code.REF_CONTRADICTION, 0.0, 0.0, "", "heights")))
    assert not any(line.startswith("found (doubtful") for line in brief_lines(bad, EvaluatedRun(wrong, gps), None))
    untold = EvaluatedRun(replace(shown, lever_sd=np.full(3, 9.0)), gps)
    assert any("early; lever arm not told; the" in line for line in brief_lines(page, untold, None))
    unsure = replace(shown, gps_delay_sd=0.05)
    assert any("on time to ± 0.050 s; lever" in line for line in brief_lines(page, EvaluatedRun(unsure, gps), None))
    given = replace(run, gps_delay_sd=0.0, lever_sd=np.zeros(3), events=())
    assert not any(line.startswith("found") for line in brief_lines(navigated.page(), EvaluatedRun(given, gps)))


def test_standard_deviations_that_were_assumed_are_listed(navigated):
    note = "600 fixes without position sigma: assumed as of a receiver without corrections"
    page = replace(navigated, notes=(note, "another")).page()
    assert note in page.assumptions
    assert page.notes == ("another",)


def test_many_rejected_fixes_are_pointed_out_and_few_are_not(driven, navigated):
    assert not navigated.page().warnings
    run, _, _ = driven
    every_other = np.arange(len(run.innovations.time)) % 2 == 0
    bad = replace(run, innovations=replace(run.innovations, used_position=every_other))
    assert "warning: many fixes were rejected, 50 % of position:" in result_of(bad).summary()
    fixes = run.innovations
    row = np.arange(fixes.time.size) // (fixes.time.size // 5) == 2  # a fifth of the drive, whatever else is named
    event = untyped_event(0.0, Code.GATE_RECORD_POSITION, 1.0, 1.0, "-", "not used")
    bad = replace(run, innovations=replace(fixes, used_velocity=~row), events=(*run.events, event))
    (told,) = [line for line in run_warnings(EvaluatedRun(bad)) if "rejected" in line]
    assert "every velocity from" in told
    assert "was rejected: false fixes, or false samples" in told


def test_a_scale_factor_that_no_sensor_has_is_pointed_out(driven):
    run, _, _ = driven
    value, sd = run.sensor_errors.value.copy(), run.sensor_errors.sd.copy()
    value[-1, 6:9], sd[-1, 6:9] = 0.17, 0.03  # but about x and y a car hardly turns
    bad = replace(run, sensor_errors=replace(run.sensor_errors, value=value, sd=sd))
    (said,) = [line for line in run_warnings(EvaluatedRun(bad)) if "scale factor" in line]
    assert "larger than any sensor has: gyro z +17 %; the drive" in said
    value[-1, 8], sd[-1, 8] = 0.08, 0.02  # not sure
    bad = replace(run, sensor_errors=replace(run.sensor_errors, value=value, sd=sd))
    assert not any("scale factor" in line for line in run_warnings(EvaluatedRun(bad)))
    assert not any("scale factor" in line for line in run_warnings(EvaluatedRun(run)))
    for first, says in ((6, True), (9, True), (12, False)):
        found = replace(run.sensor_errors, sd=np.where(np.arange(12) >= first, 0.05, sd))
        said = [line for line in run_warnings(EvaluatedRun(replace(run, sensor_errors=found))) if "agree only" in line]
        assert ["accelerometers are off by 5 % or more" in line for line in said] == [True] * says


def test_a_heading_that_turns_about_the_course_by_an_impossible_bias_is_lost(driven):
    """Of a car that drives forward and backward, a plane in wind, and a gyro that is as specified it is none."""
    run, _, _ = driven
    track, value = run.solution, run.sensor_errors.value.copy()
    moving = np.hypot(*track.v_n[:, :2].T) > 3.0
    course = np.arctan2(track.v_n[:, 1], track.v_n[:, 0])
    phase = np.linspace(0.0, 1.0, track.time.size)
    prior = np.deg2rad(0.5)
    noise = SimpleNamespace(figures=(NoiseFigure("gyro.bias", "deg/h", prior, prior, 0.1 * prior, prior, False),))

    def said(apart, bias, alignment=run.alignment):
        rph = np.column_stack([track.rph[:, :2], course + apart])
        value[-1, :3] = 0.0, 0.0, -bias * prior
        bad = replace(run, solution=replace(track, rph=rph), smoothed=None)
        bad = replace(bad, alignment=alignment, sensor_errors=replace(run.sensor_errors, value=value))
        return [line for line in run_warnings(EvaluatedRun(bad, noise=noise)) if "heading is lost" in line]

    assert moving.mean() > 0.3
    (line,) = said(np.deg2rad(250.0) * phase, 3.6)
    assert "a gyro bias of 1.8 deg/s, 3.6 times that of such an IMU" in line
    assert not said(np.deg2rad(250.0) * phase, 1.5)
    for apart in (0.0 * phase + 0.7, np.pi * (phase > 0.6), np.deg2rad(30.0) * np.sin(20.0 * phase)):
        assert not said(apart, 3.6)
    seen = replace(run.alignment, static=(0.0, 30.0), gyro_bias=np.array([0.0, 0.0, -3.6 * prior]))
    assert not said(np.deg2rad(250.0) * phase, 3.6, seen)  # a helicopter whose bias was seen at rest
    at_rest = np.where(moving, 0.0, 50.0 * phase)  # where a course is noise
    assert not said(at_rest, 3.6)


def test_how_the_imu_sits_is_assumed_and_what_aiding_found_of_it_is_not(bare):
    aside = "the IMU is turned about 50 deg to the left in the vehicle (by windows): attitude is that of the IMU"
    astray = "the vehicle does not go where it points: its heading is that of x of the IMU, found by the fixes"
    by_aiding = "NHC: lateral 0.11, vertical 0.05 m/s RMS; IMU in the vehicle: pitch -6.64 ± 0.27, yaw 5.23 ± 0.51 deg"
    half = "9 fixes have one horizontal velocity, North or East, without the other: it is not used"
    assumed = run_assumptions(result_of(bare, notes=(aside, astray, by_aiding, half)))
    assert half in assumed
    assert aside in assumed
    assert astray in assumed
    assert by_aiding not in assumed


def test_without_velocities_slow_errors_of_positions_are_said_to_be_believed(driven):
    run = driven[0]
    alone = replace(run, innovations=replace(run.innovations, nis_velocity=np.full_like(run.innovations.time, np.nan)))
    lasting = "time-correlated GPS position errors: 35 % of the variance, correlation time about 22 s, ..."
    filled_in = "9 fixes without position sigma: assumed by fix type, median N/E/D 1.50/1.50/3.00 m (floor 0.03 m)"
    cases = (
        (alone, (lasting,), True),
        (run, (lasting,), False),
        (alone, (), False),
        (alone, (lasting, filled_in), False),
    )
    for each, notes, said in cases:
        assumed = run_assumptions(result_of(each, notes=notes))
        assert any("without velocities the drive shows only how fast" in text for text in assumed) == said


def test_the_shortest_run_is_summed_up(bare):
    text = result_of(bare).summary()
    assert "no reference" in text
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


def test_fixes_that_gates_rejected_are_told(driven, navigated):
    """12 of 460 fixes were 20 m off, and the run said that fixes and solution agree."""
    run, gps, _ = driven
    fixes, kinds = run.innovations, (Code.GATE_POSITION, Code.GATE_VELOCITY, Code.GATE_VELOCITY)
    rows = np.array([40, 50, 51])
    innovation = fixes.innovation.copy()
    innovation[40, :3], innovation[50, 3:], innovation[51, 3:] = (12.0, 16.0, 0.0), (0.0, 3.0, 4.0), 1.0
    events = [
        untyped_event(float(time), kind, 99.0, 21.1, "NIS (3 dof)", "rejected")
        for time, kind in zip(fixes.time[rows], kinds, strict=True)
    ]
    other = replace(run, innovations=replace(fixes, innovation=innovation), events=tuple(events), lever_sd=np.zeros(3))
    (said,) = [
        line for line in brief_lines(navigated.page(), EvaluatedRun(other, gps), None) if line.startswith("found")
    ]
    known = np.isfinite(innovation[:, [0, 3]]).sum(axis=0)
    assert f"1 of {known[0]} positions, up to {number(20.0)} m off, rejected" in said
    assert f"2 of {known[1]} velocities, up to {number(5.0)} m/s off, rejected" in said
    innovation[40, 2] = 300.0  # of heights that the fixes do not have
    flat = replace(gps, lla=gps.lla * [1.0, 1.0, 0.0])
    text = "\n".join(brief_lines(navigated.page(), EvaluatedRun(other, flat), None))
    assert f"up to {number(20.0)} m off" in text


def test_what_went_wrong_somewhere_is_told_before_remarks_on_the_whole(driven):
    run, gps, _ = driven
    begin = float(run.solution.time[0])
    told = (begin, "sd of the fixes are too small"), (begin + 90.0, "240 position fixes contradict the whole record")
    events = tuple(untyped_event(time, Code.CONTRADICTION, 1.0, 1.0, "", text) for time, text in told)
    warnings = run_warnings(EvaluatedRun(replace(run, events=events), gps))
    assert [text[:3] for text in warnings[:2]] == ["240", "sd "]
