"""What simulations leave behind: figures of any motion and any ensemble, a page, and facts with units."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from insnav.errors.ensemble import FIGURES, GROUPS, ensemble, epochs
from insnav.exceptions import InputError
from insnav.findings import Code, Severity
from insnav.imu import load_calibration, load_imu
from insnav.input import Reading, ReadingFacts
from insnav.messages import sentence
from insnav.output.folder import RunFolder
from insnav.report.figures import draw_drawings, drawing
from insnav.report.simulation.page import (
    correlation_notes,
    ensemble_page,
    ensemble_panels,
    failures_of,
    in_folder,
    motion_panels,
    nees_panels,
    plan_key,
    run_command,
    seen,
    shown_lines,
    simulated_track,
    sketch_panel,
    track_length,
    write_recording,
    write_runs,
)
from insnav.report.terminal import brief_text
from insnav.session.simulation import Motion, Plan
from insnav.simulate import circle, corrupt_imu, gps_from_truth, imu_from_truth, reference, straight
from insnav.simulate.montecarlo import Failure, Runs
from insnav.simulate.recording import Recording, load_gps, times
from tests.shared import verify_folder
from tests.simulate.motions import PLACE, town

NO_FIX = InputError("gps.no_fix").facts

TOWN = town(start=1000.0)
STILL = straight(PLACE, 0.0, 0.3, 60.0)
ROUND = circle(PLACE, 20.0, 0.2, 120.0)  # almost four turns


def plan_of(truth, **more) -> Plan:
    values = {
        "motion": Motion("town", "two minutes of a car", truth, "# as it was\n"),
        "imu": load_imu("automotive"),
        "gps": None,
        "seed": 7,
        "rate": 20.0,
        "sampling": "mean",
        "faults": (),
        "configuration": {"imu": "automotive"},
    }
    return Plan(**values | more)


def recording_of(plan: Plan) -> Recording:
    time = times(plan.truth, plan.rate)
    made = corrupt_imu(imu_from_truth(plan.truth, time, plan.sampling), plan.imu, 1)
    lever_b = np.array([0.5, 0.0, -1.25])
    fixes = gps_from_truth(plan.truth, time[20::20], lever_b)
    return Recording(made.imu, fixes, reference(plan.truth, time[::2]), made.errors, lever_b)


def runs_of(truth, count: int = 4) -> Runs:
    """Runs with an error of the stated size in each, and one failure."""
    rng = np.random.default_rng(3)
    rows = epochs(truth)
    total = np.zeros((rows, 23))
    total[:, 0] = count
    total[:, 1:10] = rng.chisquare(count, (rows, 9)) * 0.04
    total[:, 10:19] = count * 0.04
    total[5:, 19] = count
    total[5:, 20:] = rng.chisquare(3 * count, (rows - 5, 3))
    figures = np.abs(rng.standard_normal((count, len(FIGURES))))
    figures[:, -3:] = (100.0, 2.0, 0.0)
    number = np.array([1, 2, 4, 5])
    return Runs(number, 1000 + number, figures, total, (Failure(3, 1003, NO_FIX),))


@pytest.mark.parametrize("truth", [TOWN, STILL, ROUND], ids=["town", "still", "round"])
def test_every_motion_can_be_drawn(truth, tmp_path):
    time, motion = seen(truth)
    with drawing():
        for drawings in (
            (simulated_track(time, motion),),
            motion_panels(time, motion),
            (sketch_panel(time, motion, "any"),),
        ):
            draw_drawings(drawings, "any").savefig(tmp_path / "figure.png")
    assert len(time) <= 20_001
    assert time[0] == truth.start


def test_motion_is_drawn_in_the_units_of_its_labels():
    time, motion = seen(ROUND)
    by_label = {panel.y_label: [curve.y for curve in panel.curves] for panel in motion_panels(time, motion)}
    assert set(by_label) == {
        "speed [m/s]", "height [m]", "angle [deg]", "heading [deg]", "rate [deg/s]", "force [m/s²]",
    }  # fmt: skip
    assert by_label["speed [m/s]"][0].max() == pytest.approx(20.0, rel=1e-3)
    bank = np.degrees(np.arctan2(20.0 * 0.2, 9.81))
    assert by_label["angle [deg]"][0][0] == pytest.approx(bank, abs=0.05)
    assert by_label["rate [deg/s]"][2][0] == pytest.approx(np.degrees(0.2) * np.cos(np.radians(bank)), abs=0.05)
    heading = by_label["heading [deg]"][0]
    assert np.nanmax(heading) <= 360.0


def test_length_of_the_track():
    assert track_length(*seen(ROUND)) == pytest.approx(20.0 * 120.0, rel=1e-3)


def test_a_recording_leaves_everything_behind(tmp_path):
    plan = plan_of(TOWN)
    with RunFolder(tmp_path / "sim", force=False) as folder:
        where, _ = write_recording(folder, plan, recording_of(plan))
    verify_folder(where)
    facts = json.loads((where / "run.json").read_text())
    assert set(facts["files"]) == {
        "imu.csv", "gps.csv", "ref.csv", "imu.toml", "profile.toml", "sensor_realisation.toml", "report.html",
    }  # fmt: skip
    assert facts["motion"]["start_lat_deg"] == pytest.approx(48.0)
    assert facts["motion"]["max_specific_force_m_s2"][2] > 9.8
    drawn = load_calibration(where / "sensor_realisation.toml")
    assert facts["sensor_realisation"]["accel_bias_mg"] == pytest.approx(list(drawn.accel_bias / 9.80665e-3), rel=1e-9)
    html = (where / "report.html").read_text()
    assert "two minutes of a car" in html
    assert facts["command"] in html


def test_the_command_names_what_a_reader_cannot_know(tmp_path):
    plan = plan_of(TOWN, sampling="instant")
    command = run_command(plan, np.array([0.5, 0.0, -1.25]), seen(TOWN)[1])
    assert "--lever-arm 0.5,0,-1.25" in command
    assert "--imu-sampling instant" in command
    assert "--lever-arm 0,0,0" in run_command(plan, np.zeros(3), seen(TOWN)[1])  # not given would be unknown
    assert run_command(plan_of(TOWN, imu=None), np.zeros(3), seen(TOWN)[1]).endswith("--imu navigation")
    at_rest = seen(STILL)[1]
    assert "--heading 17.2" in run_command(plan, np.zeros(3), at_rest)  # 0.3 rad, and nothing else can tell it
    assert "--heading" not in run_command(plan_of(STILL, imu=load_imu("navigation")), np.zeros(3), at_rest)
    assert "--heading" not in command
    said = in_folder(command, tmp_path / "a b")
    assert f"'{tmp_path}/a b/imu.csv'" in said
    assert said.endswith("imu.toml'")


def test_lines_say_what_was_simulated_and_how_to_go_on(tmp_path):
    plan = plan_of(TOWN)
    with RunFolder(tmp_path / "sim", force=False) as folder:
        where, page = write_recording(folder, plan, recording_of(plan))
    lines = shown_lines(page, where)
    assert [line[:12].strip() for line in lines] == ["motion", "IMU", "GPS", "files", "next"]
    assert "seed 7" in lines[2]


def test_runs_leave_a_row_each_and_a_row_each_second(tmp_path):
    runs = runs_of(TOWN)
    with RunFolder(tmp_path / "ens", force=False) as folder:
        where, page = write_runs(folder, plan_of(TOWN), runs)
    verify_folder(where)
    facts = json.loads((where / "run.json").read_text())
    with (where / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["run"] for row in rows] == ["1", "2", "4", "5"]
    assert [row["seed"] for row in rows] == ["1001", "1002", "1004", "1005"]
    assert [row["rejected"] for row in rows] == ["2"] * 4
    pitch = runs.figures[:, FIGURES.index("rms_pitch")]
    np.testing.assert_allclose([float(row["rms_pitch_deg"]) for row in rows], np.degrees(pitch), atol=1e-6)
    with (where / "ensemble.csv").open() as file:
        seconds = list(csv.DictReader(file))
    assert len(seconds) == epochs(TOWN)
    assert float(seconds[0]["sd_v_north_m_s"]) == pytest.approx(0.2)
    assert float(seconds[0]["sd_roll_deg"]) == pytest.approx(np.degrees(0.2), rel=1e-6)
    assert float(seconds[7]["rms_down_m"]) == pytest.approx(np.sqrt(runs.total[7, 3] / 4), abs=1e-6)
    assert seconds[0]["nees_position_per_axis"] == ""  # no fix yet
    assert float(seconds[9]["nees_attitude_per_axis"]) == pytest.approx(runs.total[9, 22] / 12, abs=1e-6)
    found = facts["ensemble"]
    assert found["failed"] == [{"run": 3, "seed": 1003, "code": "gps.no_fix"}]
    assert (found["fixes"], found["rejected"], found["resets"]) == (400, 8, 0)
    lines = brief_text(page, None)
    (failed,) = failures_of(runs)
    assert failed.values == (("run", 3), ("seed", 1003), ("cause", NO_FIX))
    assert (failed.code, failed.severity) == (Code.SIMULATION_RUN_FAILED, Severity.WARNING)
    assert sentence(failed) in lines
    assert "8 of 400 fixes" in lines
    assert sentence(failed) in (where / "report.html").read_text()


def test_the_band_of_the_figure_is_about_the_stated_sd():
    found = ensemble(runs_of(TOWN), TOWN)
    panels = ensemble_panels(found)
    assert len(panels) == 9
    assert len(nees_panels(found)) == 3
    band, stated, _ = panels[0].curves
    np.testing.assert_allclose(stated.y, 0.2, rtol=1e-9)
    assert band.low.min() == pytest.approx(0.2 * np.sqrt(0.4844 / 4), rel=1e-3)  # chi-square of 4, 2.5 % and 97.5 %
    assert band.y.max() == pytest.approx(0.2 * np.sqrt(11.1433 / 4), rel=1e-3)


def test_the_same_ensemble_gives_the_same_bytes(tmp_path):
    for name in ("one", "two"):
        with RunFolder(tmp_path / name, force=False) as folder:
            write_runs(folder, plan_of(TOWN), runs_of(TOWN))
    files = {name: {p.relative_to(tmp_path / name): p.read_bytes() for p in (tmp_path / name).rglob("*.*")}
             for name in ("one", "two")}  # fmt: skip
    assert files["one"] == files["two"]


def test_runs_without_a_fix_are_told_as_such(tmp_path):
    runs = runs_of(TOWN)
    runs.total[:, 19:] = 0.0
    with RunFolder(tmp_path / "ens", force=False) as folder:
        where, page = write_runs(folder, plan_of(TOWN), runs)
    facts = json.loads((where / "run.json").read_text())
    assert facts["ensemble"]["nees_inside_band"] == {}
    assert any("there was no fix" in line for line in page.summary)
    assert not (where / "figures" / "nees.png").exists()


def test_time_correlated_errors_of_the_receiver_explain_an_over_confident_position():
    single = load_gps("single")
    white = replace(single, errors=replace(single.errors, position_drift=(0.0, 0.0, 0.0)))
    for gps, nees, said in ((single, 9.0, True), (single, 1.0, False), (white, 9.0, False), (None, 9.0, False)):
        noted = correlation_notes(gps, {"position": nees})
        assert [each.code for each in noted] == [Code.SIMULATION_CORRELATED_FIXES] * said
        for each in noted:
            assert (each.subject, each["correlation_time_s"]) == ("single", 100.0)
            assert each["share"] == pytest.approx(0.78, abs=0.005)


def test_a_digest_stands_for_everything_that_matters():
    plan = plan_of(TOWN)
    assert plan_key(plan) == plan_key(plan_of(TOWN))
    track = Reading(plan.truth, (), ReadingFacts("reference", "ref.csv", "a", 2, 2, 0.0, 1.0, 1.0, 0, 0.0, {}))
    others = [
        {"motion": replace(plan.motion, track=track)},
        {"seed": 8},
        {"motion": replace(plan.motion, profile="# other\n")},
        {"configuration": {"rate_hz": 5.0}},
        {"imu": load_imu("tactical")},
    ]
    assert len({plan_key(plan), *(plan_key(replace(plan, **other)) for other in others)}) == 6


@pytest.mark.parametrize(("count", "limit"), [(4, 23.337 / 12), (40, 152.211 / 120)])  # chi-square 0.975, tables
def test_an_ensemble_is_good_as_long_as_chance_may_have_made_its_errors(count: int, limit: float):
    rows = np.arange(count)
    figures = np.ones((count, len(FIGURES)))
    for off, light in ((-0.01, "good"), (0.01, "attention")):
        figures[:, [FIGURES.index(f"nees_{name}") for name in GROUPS]] = limit + off
        runs = replace(runs_of(TOWN), number=rows, figures=figures, failures=())
        verdict = ensemble_page(plan_of(TOWN), ensemble(runs, TOWN), runs).verdict
        assert verdict is not None
        assert verdict.light == light, verdict.reason
