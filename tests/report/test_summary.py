"""The summary fits a few lines and says what matters."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from insnav.errors.evaluated_run import EvaluatedRun, judged, run_warnings
from insnav.errors.metrics import position_errors
from insnav.filter.noise_estimate import NoiseFigure
from insnav.findings import Code, Finding, Severity
from insnav.imu import load_imu
from insnav.messages import form, phrase, render, sentence, word
from insnav.quantity import Quantity, quantity_of
from insnav.report.page import Page, Section, Verdict, cell, section_tables
from insnav.report.panels import Clock
from insnav.report.run.page import brief_lines, inside, run_merits
from insnav.report.run.quantities import mean_nis
from insnav.report.style import number
from insnav.result import Result
from insnav.sample_statistics import rms, rms_length
from insnav.types import AidingUse
from tests.report.conftest import READING, result_of, stored

WARNING = Severity.WARNING
ASSUMPTION = Severity.ASSUMPTION
LINES = 15  # of a common run on a terminal of 80 columns or more


def seen(result: Result, found: EvaluatedRun, **more) -> Page:
    """Page of a result that found something else."""
    return judged(replace(result, found=found, **more), found).page()


def in_words(findings, time) -> tuple[str, ...]:
    """Warnings of a run of these times."""
    clock = Clock.of(time)
    return Page("", (), (), tuple(findings), at=clock.moment, starts_at=clock.start).warnings


def test_wrong_inputs_are_named_before_their_effects(navigated):
    lost = Finding.of(Code.RUN_HEADING_LOST, severity=Severity.UNUSABLE)
    effects = [Finding.of(code, severity=WARNING) for code in (Code.RUN_LATE_FIXES, Code.CHECK_NO_SD)]
    wrong = [Finding.of(code) for code in (Code.GIVEN_DELAY_REJECTED, Code.MOUNTING_CONTRADICTS_GIVEN)]
    kept = Finding.of(Code.IMU_MODEL_GIVEN)
    shown = seen(navigated, navigated.found, findings=(kept, *effects, *wrong, lost)).findings
    serious = [each for each in shown if each in {*effects, *wrong, lost}]
    assert serious == [lost, *wrong, *effects]
    assert shown.index(kept) > shown.index(effects[-1])


def test_a_few_lines_say_what_matters(navigated):
    text = navigated.summary()
    lines = text.splitlines()
    for width in (80, 160):
        rows = brief_lines(navigated.page(), navigated.found, width)
        assert len(rows) < LINES  # the command adds the files
        assert max(map(len, rows)) <= width
        whole = brief_lines(navigated.page(), navigated.found)
        assert "".join(" ".join(rows).split()) == "".join(" ".join(whole).split())  # nothing is cut
    drive = phrase("terminal.line", name="drive.csv", text="10.0 min")
    figure = f"{phrase('run.error_of', part=word('horizontal'))} [m]"
    for words in (drive, phrase("run.outages", count=1, longest="30.0 s"), figure, phrase("run.filtered")):
        assert words in text
    row = next(line for line in lines if line.strip().startswith(figure))
    assert row.split()[-1] == number(rms(navigated.found.errors.horizontal))


def test_errors_far_within_what_is_stated_are_said_so(navigated):
    found = navigated.found
    assert navigated.page().verdict.reason == phrase("run.good")
    careful = replace(found.errors, sd=10.0 * found.errors.sd)
    far = replace(found, errors=careful, smoothed_errors=None)
    reason = replace(navigated, found=far).page().verdict.reason
    assert reason.startswith(phrase("run.good"))
    assert reason != phrase("run.good")
    (stated,) = [each for each in run_merits(far, "filtered") if each.key == "horizontal_sd"]
    assert stated.value == pytest.approx(10.0 * float(np.sqrt(np.mean(np.sum(found.errors.sd[:, :2] ** 2, axis=1)))))


def test_times_in_a_text_stand_on_the_axis_of_the_plots_and_lengths_as_they_are():
    short, long = (Clock.of(np.array([1000.0, 1000.0 + length])) for length in (600.0, 1800.0))
    turn = Finding.of(Code.RUN_TURNED_IN_PLACE, 1300.04, 1330.0, angle_rad=np.deg2rad(190.2))
    reset = Finding.of(Code.RUN_RESET, 1100.0, count=1, distance_m=1.9e2)
    for clock, span, moment in ((short, "300.0 to 330.0 s", "100.0 s"), (long, "5.00 to 5.50 min", "1.67 min")):
        for finding, parts in ((turn, (span, "190 deg")), (reset, (moment, "190 m"))):
            assert all(part in clock.sentence(finding) for part in parts)
    assert short.moment(990.0, 990.0) == "10.0 s before the start"


def test_warnings_count_from_the_start_of_the_run(driven):
    run, gps, _ = driven
    later = replace(run, solution=replace(run.solution, time=run.solution.time + 1000.0))
    lost = Finding.of(Code.IMU_STUCK, 1012.0, subject="gyro x", duration_s=3.0)
    (stuck,) = run_warnings(EvaluatedRun(replace(later, events=(lost,)), gps))
    assert (stuck.code, stuck.severity, stuck.begin, stuck.subject) == (Code.RUN_STUCK, WARNING, 1012.0, "gyro x")
    assert dict(stuck.values) == {"duration_s": 3.0, "count": 1}
    (said,) = in_words([stuck], later.solution.time)
    assert "12.0 s" in said
    assert said.endswith("(times in warnings are from the start)")
    more = (lost, replace(lost, subject="gyro y"), replace(lost, begin=1100.0))
    both = run_warnings(EvaluatedRun(replace(later, events=more), gps))
    sums = [(each.subject, each["duration_s"], each["count"]) for each in both]
    assert sums == [("gyro x", 6.0, 2), ("gyro y", 3.0, 1)]
    several = in_words(both, later.solution.time)
    assert sum("from the start" in text for text in several) == 1  # the first says it for all
    early = run_warnings(EvaluatedRun(replace(run, events=(replace(lost, begin=12.0),)), gps))
    assert not any("from the start" in text for text in in_words(early, run.solution.time))  # begins at zero


@pytest.mark.parametrize(("share", "said"), [(0.2, False), (0.5, True)])
def test_fixes_before_a_late_start_are_pointed_out_where_they_are_many(driven, share, said):
    run, gps, _ = driven
    used, begin = run.innovations.time.size, float(run.solution.time[0])
    early = round(share / (1.0 - share) * used)
    outside = Finding.of(Code.GPS_OUTSIDE, begin, count=early)
    after = Finding.of(Code.GPS_OUTSIDE, begin + 600.0, count=9 * used)
    found = run_warnings(EvaluatedRun(replace(run, events=(outside, after)), gps))
    late = [dict(each.values) for each in found if each.code is Code.RUN_LATE_START]
    assert late == [{"count": early, "of": early + used}] * said


def test_a_constant_difference_is_named_as_what_it_is(driven, navigated):
    """A base station 5 sd lower, and a few epochs that are far off."""
    run, gps, _ = driven
    errors = navigated.found.errors
    lower = errors.position + np.array([0.0, 0.0, 5.0 * float(np.median(errors.sd[:, 2]))])
    (said,) = run_warnings(EvaluatedRun(run, gps, replace(errors, position=lower)))
    assert (said.code, said.severity, said.subject) == (Code.RUN_OVERCONFIDENT_OFFSET, WARNING, "filtered")
    assert said["down_m"] == np.median(lower[:, 2])
    assert said["rest"] < 0.5 * said["share"]
    wild = errors.position * np.where(np.arange(len(errors.time)) % 10, 0.01, 40.0)[:, None]
    (said,) = run_warnings(EvaluatedRun(run, gps, replace(errors, position=wild)))
    assert said.code is Code.RUN_OVERCONFIDENT


def test_a_few_wild_epochs_do_not_hide_how_good_the_rest_is(driven, navigated):
    run, gps, _ = driven
    errors = navigated.found.errors
    wild = errors.position * np.where(np.arange(len(errors.time)) % 50, 1.0, 300.0)[:, None]
    worse = replace(navigated, found=EvaluatedRun(run, gps, replace(errors, position=wild)))
    most = number(float(np.percentile(np.hypot(*wild[:, :2].T), 95.0)))
    size = number(float(np.sqrt(np.mean(np.sum(wild[:, :2] ** 2, axis=1)))))
    said = phrase("run.error_size", size=size, mode=phrase("run.filtered"), most=most)
    assert said in worse.page().verdict.sentence
    size = number(rms(errors.horizontal))
    assert phrase("run.error_size", size=size, mode=phrase("run.filtered")) in navigated.page().verdict.sentence


def test_a_notebook_gets_the_tables(navigated):
    shown = navigated._repr_html_()
    assert "horizontal [m]" in shown
    assert "Options" not in shown
    assert shown.count('<dl class="merits">') == 1
    assert shown.count('<img alt="') == 2  # map and errors
    assert "Track" in shown.partition("<img")[2].partition(">")[0]
    rules = shown.partition("<style>")[2].partition("</style>")[0]
    assert rules.startswith(".insnav {")  # the rest of the notebook keeps its style
    assert not re.search(":root|body", rules)


def test_a_crowded_and_hostile_run_still_fits(navigated):
    page = navigated.page()
    noise = [stored(f"\x1b[31mwarning {i} " + "x" * 300, each) for each in (WARNING, ASSUMPTION) for i in range(50)]
    crowd = replace(page, title="p" * 200, findings=tuple(noise))
    lines = brief_lines(crowd, navigated.found, 80)
    assert max(map(len, lines)) <= 80
    assert "…" not in "".join(lines)
    assert not any("\x1b" in line for line in lines)
    for name in ("warning", "assumed"):
        first = tuple(phrase("terminal.first_of", name=phrase(f"run.{name}"), most=k, count=50) for k in range(1, 7))
        assert sum(line.startswith(first) for line in lines) == 1


def test_the_light_follows_the_harm(driven, navigated):
    assert navigated.page().verdict.light == "good"
    run, gps, true = driven
    few = replace(run, solution=replace(run.solution, sd=0.1 * run.solution.sd))
    wrong = position_errors(few.solution, true)
    bad = seen(navigated, EvaluatedRun(few, gps, wrong))
    assert bad.verdict.light == "bad"
    assert phrase("run.sd_fails", share=inside(wrong)) in bad.verdict.sentence
    assert bad.warnings
    errors = navigated.found.errors
    part = replace(navigated, found=EvaluatedRun(run, gps, errors.rows(slice(len(errors.time) // 4)))).page().verdict
    assert part.light == "unknown"
    assert part.reason == phrase("run.part", share=0.25)
    alone = replace(navigated, found=EvaluatedRun(run, gps)).page().verdict
    assert alone.light == "unknown"
    assert alone.reason == phrase("run.agree", nis=number(mean_nis(run)))
    size = phrase("run.sd_size", size=number(rms_length(run.solution.sd[:, :2])), mode=phrase("run.filtered"))
    assert alone.sentence == phrase("run.sd", sizes=(size,))
    fixes = run.innovations
    wild = replace(fixes, nis_position=4.0 * fixes.nis_position, nis_velocity=4.0 * fixes.nis_velocity)
    scattered = replace(run, innovations=wild)
    doubtful = replace(navigated, found=EvaluatedRun(scattered, gps)).page().verdict
    assert doubtful.light == "attention"
    assert doubtful.reason == phrase("run.scatter_more", nis=number(mean_nis(scattered)))


def test_a_reference_that_is_late_does_not_condemn_the_solution(driven, navigated):
    run, gps, true = driven
    late = replace(true, time=true.time + 1.0)
    event = Finding.of(Code.REF_CLOCK, subject="ref", late_s=1.0, limit_s=0.03, rms_m=9.0, corrected_m=1.0)
    found = EvaluatedRun(run, gps, position_errors(run.solution, late))
    assert replace(navigated, found=found).page().verdict.light == "bad"
    said = replace(navigated, found=replace(found, run=replace(run, events=(*run.events, event)))).page()
    right, wrong = (number(rms(each.horizontal)) for each in (position_errors(run.solution, true), found.errors))
    assert said.verdict.light == "attention"
    unmoved = phrase("run.unmoved", shift_s=-1.0, size=wrong)
    assert said.verdict.reason == phrase("run.late_reference", size=right, unmoved=unmoved)
    for words in (right, unmoved):
        assert words in said.verdict.sentence
    shown = replace(run, events=(*run.events, event), gps_delay=-0.7, gps_delay_sd=0.1)  # which explains it
    of_fixes = replace(navigated, found=replace(found, run=shown)).page().verdict.reason
    assert of_fixes == phrase("run.late_fixes", size=right, unmoved=unmoved)
    fixes = replace(run.innovations, nis_position=4.0 * run.innovations.nis_position)  # which contradict it
    wild = replace(run, events=(*run.events, event), innovations=fixes)
    contradicted = replace(navigated, found=replace(found, run=wild)).page().verdict.reason
    assert said.verdict.reason not in contradicted


def test_a_lever_arm_of_zero_is_an_assumption_unless_it_was_given(driven, navigated):
    run, gps, _ = driven
    nothing = replace(run, lever_b=np.zeros(3), lever_sd=np.zeros(3))
    zero, plain = Finding.of(Code.RUN_LEVER_ZERO), replace(navigated, findings=())
    page = seen(plain, EvaluatedRun(nothing, gps), options={})
    assert page.findings[0] == zero
    assert page.assumptions[0] == sentence(zero)
    assert zero not in seen(plain, EvaluatedRun(nothing, gps), options={"lever_arm": "0,0,0"}).findings


def test_what_was_not_given_is_said_as_the_drive_shows_it(driven, navigated):
    run, gps, _ = driven
    arm, sd = np.array([1.0, 0.0, -0.5]), np.array([0.1, 0.02, 0.003])
    shown = replace(run, gps_delay=-0.069, gps_delay_sd=0.004, lever_b=arm, lever_sd=sd)
    page = navigated.page()
    notes = Finding.of(Code.IMU_CLOCK_RATE, rate=292e-6), Finding.of(Code.REF_NOT_FIXED, count=3), stored("other")
    lines = brief_lines(replace(page, findings=notes), EvaluatedRun(shown, gps), None)
    sure, doubtful = (phrase("terminal.line", name=phrase(f"run.{x}estimates"), text="") for x in ("", "doubtful_"))
    early = phrase("run.delay", delay_s=-0.069, sd_s=0.004)
    lever = phrase("run.lever", arm=("1.00 ± 0.10 m", "0.00 ± 0.02 m", "-0.50 ± 0.01 m"))
    (said,) = [line for line in lines if line.startswith((sure, doubtful))]
    assert said.endswith(f"{early}{form('parts')}{lever}")
    assert phrase("terminal.line", name=phrase("run.corrected"), text=render(notes[0]).text) in lines
    bad = replace(page, verdict=Verdict("bad", "the errors are larger than stated", ""))
    assert any(line.startswith(doubtful) for line in brief_lines(bad, EvaluatedRun(shown, gps), None))
    wrong = replace(shown, events=(*shown.events, Finding.of(Code.REF_GEOID, subject="ref", height_m=47.0)))
    assert not any(line.startswith(doubtful) for line in brief_lines(bad, EvaluatedRun(wrong, gps), None))
    untold = EvaluatedRun(replace(shown, lever_sd=np.full(3, 9.0)), gps)
    unknown = f"{early}{form('parts')}{phrase('run.unknown_lever')}"
    assert any(line.endswith(unknown) for line in brief_lines(page, untold, None))
    unsure = replace(shown, gps_delay_sd=0.05)
    on_time = f"{phrase('run.on_time', sd_s=0.05)}{form('parts')}{lever}"
    assert any(on_time in line for line in brief_lines(page, EvaluatedRun(unsure, gps), None))
    given = replace(run, gps_delay_sd=0.0, lever_sd=np.zeros(3), events=())
    untouched = brief_lines(navigated.page(), EvaluatedRun(given, gps), None)
    assert not any(line.startswith((sure, doubtful)) for line in untouched)


def test_standard_deviations_that_were_assumed_are_listed(navigated):
    note = stored("600 fixes have an assumed sd", ASSUMPTION)
    doubt = replace(note, severity=WARNING)
    page = replace(navigated, findings=(note, stored("another"), doubt)).page()
    assert page.assumptions == (sentence(note), *page.method)
    assert page.notes == ("another",)
    assert page.warnings == (sentence(doubt),)
    assert page.verdict.light == "attention"


def test_many_rejected_fixes_are_pointed_out_and_few_are_not(driven, navigated):
    assert not navigated.page().warnings
    run, _, _ = driven
    every_other = np.arange(len(run.innovations.time)) % 2 == 0
    bad = replace(run, innovations=replace(run.innovations, used_position=every_other))
    (many,) = run_warnings(EvaluatedRun(bad))
    assert (many.code, many.severity) == (Code.RUN_MANY_REJECTED, WARNING)
    assert dict(many.values) == {"share": pytest.approx(0.5, abs=0.01)}
    assert "50 %" in sentence(many)
    said = phrase("terminal.line", name=phrase("run.warning"), text=sentence(many))
    assert " ".join(said.split())[:40] in " ".join(result_of(bad).summary().split())
    fixes = run.innovations
    row = np.arange(fixes.time.size) // (fixes.time.size // 5) == 2  # a fifth of the drive, whatever else is named
    event = Finding.of(Code.GATE_RECORD_POSITION, 0.0, distance_m=1.0)
    bad = replace(run, innovations=replace(fixes, used_velocity=~row), events=(*run.events, event))
    (told,) = run_warnings(EvaluatedRun(bad))
    assert (told.code, told.subject, told.values) == (Code.RUN_ROW_REJECTED, "velocity", ())
    assert (told.begin, told.end) == (fixes.time[row][0], fixes.time[row][-1])


@pytest.mark.parametrize(("name", "rejected", "warned"), [("heading", 11, 1), ("heading", 9, 0), ("nhc", 60, 0)])
def test_rejected_headings_are_pointed_out_with_their_number(driven, name, rejected, warned):
    """More than a tenth, as of the fixes. Constraints that turns break are no measurements."""
    run, _, _ = driven
    bad = replace(run, aiding=(AidingUse(name, 100, rejected, 0.01, 1.0, "rad"),))
    found = [each for each in run_warnings(EvaluatedRun(bad)) if each.code is Code.RUN_HEADINGS_REJECTED]
    assert [(each["count"], each["total"], each.severity) for each in found] == [(11, 100, WARNING)] * warned


def test_a_scale_factor_that_no_sensor_has_is_pointed_out(driven):
    run, _, _ = driven
    value, sd = run.sensor_errors.value.copy(), run.sensor_errors.sd.copy()
    value[-1, 6:9], sd[-1, 6:9] = 0.17, 0.03  # but about x and y a car hardly turns
    bad = replace(run, sensor_errors=replace(run.sensor_errors, value=value, sd=sd))
    (said,) = run_warnings(EvaluatedRun(bad))
    assert (said.code, said["axes"], said["share"]) == (Code.RUN_SCALE, ("gyro z",), (0.17,))
    value[-1, 8], sd[-1, 8] = 0.08, 0.02  # not sure
    bad = replace(run, sensor_errors=replace(run.sensor_errors, value=value, sd=sd))
    assert run_warnings(EvaluatedRun(bad)) == run_warnings(EvaluatedRun(run)) == ()
    for first, says in ((6, True), (9, True), (12, False)):
        found = replace(run.sensor_errors, sd=np.where(np.arange(12) >= first, 0.05, sd))
        said = run_warnings(EvaluatedRun(replace(run, sensor_errors=found)))
        shares = [each["share"] for each in said if each.code is Code.RUN_SCALE_OF_ALL]
        assert shares == [0.05] * says


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
        return [line for line in run_warnings(EvaluatedRun(bad, noise=noise)) if line.code is Code.RUN_HEADING_LOST]

    assert moving.mean() > 0.3
    (line,) = said(np.deg2rad(250.0) * phase, 3.6)
    assert line["rate_rad_s"] == pytest.approx(3.6 * prior, rel=1e-3)
    assert line["ratio"] == pytest.approx(3.6, rel=1e-3)
    assert not said(np.deg2rad(250.0) * phase, 1.5)
    for apart in (0.0 * phase + 0.7, np.pi * (phase > 0.6), np.deg2rad(30.0) * np.sin(20.0 * phase)):
        assert not said(apart, 3.6)
    seen = replace(run.alignment, static=(0.0, 30.0), gyro_bias=np.array([0.0, 0.0, -3.6 * prior]))
    assert not said(np.deg2rad(250.0) * phase, 3.6, seen)  # a helicopter whose bias was seen at rest
    at_rest = np.where(moving, 0.0, 50.0 * phase)  # where a course is noise
    assert not said(at_rest, 3.6)


def test_what_is_assumed_is_told_by_its_severity(bare):
    notes = [stored(each.name, each) for each in Severity]
    model = load_imu("consumer"), replace(notes[1], subject="model")
    of_file = replace(READING["imu"], evidence=(stored("text"), replace(notes[1], subject="imu"), notes[0]))

    def assumed(**more):
        found = result_of(bare, findings=(stored("text"), *notes[:2]), **more).findings
        return [each for each in found if each.severity is ASSUMPTION]

    assert [each.subject for each in assumed(inputs={"imu": of_file}, imu_model=model)] == ["", "model", "imu"]
    assert assumed(imu_model=(model[0], notes[0])) == [notes[1]]


def test_without_velocities_slow_errors_of_positions_are_said_to_be_believed(driven):
    run = driven[0]
    alone = replace(run, innovations=replace(run.innovations, nis_velocity=np.full_like(run.innovations.time, np.nan)))
    lasting, filled_in = (Finding.of(code) for code in (Code.ESTIMATE_CORRELATED, Code.GPS_POSITION_SD_FIX_TYPE))
    cases = (
        (alone, (lasting,), True),
        (run, (lasting,), False),
        (alone, (), False),
        (alone, (lasting, filled_in), False),
    )
    for each, notes, said in cases:
        slow = [found for found in result_of(each, findings=notes).findings if found.code is Code.RUN_SLOW_ERRORS]
        assert [found.severity for found in slow] == [ASSUMPTION] * said


def test_the_shortest_run_is_summed_up(bare):
    text = result_of(bare).summary()
    assert phrase("run.no_reference") in text
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
    assert cell(Quantity("any", {"a": True})) == f"a {phrase('page.yes')}"


def test_fixes_that_gates_rejected_are_told(driven, navigated):
    """12 of 460 fixes were 20 m off, and the run said that fixes and solution agree."""
    run, gps, _ = driven
    fixes, kinds = run.innovations, (Code.GATE_POSITION, Code.GATE_VELOCITY, Code.GATE_VELOCITY)
    rows = np.array([40, 50, 51])
    innovation = fixes.innovation.copy()
    innovation[40, :3], innovation[50, 3:], innovation[51, 3:] = (12.0, 16.0, 0.0), (0.0, 3.0, 4.0), 1.0
    events = [
        Finding.of(code, float(time), nis=99.0, limit_nis=21.1)
        for time, code in zip(fixes.time[rows], kinds, strict=True)
    ]
    other = replace(run, innovations=replace(fixes, innovation=innovation), events=tuple(events), lever_sd=np.zeros(3))
    text = "\n".join(brief_lines(navigated.page(), EvaluatedRun(other, gps), None))
    known = np.isfinite(innovation[:, [0, 3]]).sum(axis=0)
    positions = phrase("run.rejected_positions", count=1, total=int(known[0]), most=f"{number(20.0)} m")
    velocities = phrase("run.rejected_velocities", count=2, total=int(known[1]), most=f"{number(5.0)} m/s")
    assert f"{positions}{form('parts')}{velocities}" in text
    innovation[40, 2] = 300.0  # of heights that the fixes do not have
    flat = replace(gps, lla=gps.lla * [1.0, 1.0, 0.0])
    text = "\n".join(brief_lines(navigated.page(), EvaluatedRun(other, flat), None))
    assert positions in text


def test_what_went_wrong_somewhere_is_told_before_remarks_on_the_whole(driven):
    run, gps, _ = driven
    begin = float(run.solution.time[0])
    times = (begin, begin + 90.0, np.nan)
    events = tuple(Finding.of(Code.STORED_TEXT, time, severity=WARNING, text="") for time in times)
    reference = Finding.of(Code.REF_GEOID, subject="ref", height_m=47.0)
    told = run_warnings(EvaluatedRun(replace(run, events=(reference, *events), gps_delay=0.3, gps_delay_sd=0.01), gps))
    assert told[:3] == (events[1], events[0], events[2])
    assert [each.code for each in told[3:]] == [Code.RUN_LATE_FIXES, Code.REF_GEOID]


def test_what_is_found_many_times_is_one_warning(driven):
    """Each is serious, and the page has their sum."""
    run, gps, _ = driven
    begin = float(run.solution.time[0])
    resets = [Finding.of(Code.FILTER_RESET, begin + 50.0 * k, severity=WARNING, distance_m=20.0 + k) for k in range(2)]
    first = Finding.of(Code.FILTER_DIVERGED, begin, severity=WARNING, subject="position", nis=6.0)
    events = (*resets, first, replace(first, begin=begin + 60.0))
    reset, diverged = run_warnings(EvaluatedRun(replace(run, events=events), gps))
    assert (reset.code, reset.begin, reset["count"], reset["distance_m"]) == (Code.RUN_RESET, begin, 2, 20.0)
    assert (diverged.code, diverged.subject, diverged["count"]) == (Code.RUN_DIVERGED, "position", 2)
    assert diverged["nis"] == 6.0


def test_samples_lost_for_different_causes_are_different_warnings(driven):
    run, gps, _ = driven
    lost = (
        (Code.IMU_SATURATED, Code.RUN_SATURATED),
        (Code.IMU_LIMITED, Code.RUN_LIMITED),
        (Code.IMU_STUCK, Code.RUN_STUCK),
        (Code.IMU_FROZEN, Code.RUN_STUCK),
        (Code.ROWS_GAP, Code.RUN_GAPS),
    )
    for code, warning in lost:
        events = tuple(Finding.of(code, 50.0 + k, subject="imu", duration_s=2.0) for k in range(3))
        (found,) = run_warnings(EvaluatedRun(replace(run, events=events), gps))
        assert (found.code, found["count"], found["duration_s"]) == (warning, 3, 6.0)
        assert sentence(found)


def test_heights_that_were_not_measured_are_told(driven):
    run, gps, _ = driven
    for height, code in ((0.0, Code.RUN_NO_HEIGHTS), (12.0, Code.RUN_CONSTANT_HEIGHT)):
        flat = replace(gps, lla=gps.lla * [1.0, 1.0, 0.0] + [0.0, 0.0, height])
        (said,) = run_warnings(EvaluatedRun(run, flat))
        assert (said.code, said.severity, said.get("height_m", 0.0)) == (code, WARNING, height)
