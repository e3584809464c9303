"""The doctor: each defect put into a drive is found, and a sound drive has none of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import insnav
from insnav.errors.evaluated_run import _held, run_warnings
from insnav.exceptions import InputError
from insnav.filter.agreement import look_at_fixes
from insnav.findings import Code, Finding, Severity, of_code
from insnav.imu.inspection import inspect_samples
from insnav.messages import sentence
from insnav.result import Result
from insnav.session.check import WORST_FIRST, Checked, check
from insnav.types import GpsData, ImuData, Trajectory
from tests.input.spellings.imu_files import FLU, SHORT, iso
from tests.input.spellings.recorded import DEG, GPS_HEADERS, IMU_HEADERS, drive, fixes, samples, table, text

SAMPLE = Path(__file__).parents[2] / "trajectories" / "sample"


@pytest.fixture(scope="module")
def made():
    return insnav.simulate("city", imu="industrial", gps="rtk", seed=2, rate=50.0)


def test_vibration_quantisation_and_repeats_are_seen():
    rng = np.random.default_rng(1)
    t = np.arange(20_000) / 200.0
    gyro = np.round(rng.normal(0.0, 0.01, (len(t), 3)) / 0.02) * 0.02
    accel = rng.normal(0.0, 0.02, (len(t), 3)) + np.array([0.0, 0.0, -9.8])
    accel[:, 1] += 0.5 * np.sin(2.0 * np.pi * 31.0 * t)
    found = inspect_samples(ImuData(t, gyro, accel), None)
    assert found.peaks[0].axis == "y"
    assert found.peaks[0].frequency == pytest.approx(31.0, abs=0.3)
    assert found.peaks[0].rms == pytest.approx(0.5 / np.sqrt(2.0), rel=0.05)
    assert [each.resolution for each in found.axes[:3]] == pytest.approx([0.02] * 3, rel=1e-6)
    assert found.axes[3].resolution == 0.0
    assert found.axes[0].repeated == pytest.approx(np.mean(np.diff(gyro[:, 0]) == 0.0))


def test_a_knock_at_rest_is_seen():
    rng = np.random.default_rng(1)
    t = np.arange(10_000) / 100.0
    accel = rng.normal(0.0, 0.01, (len(t), 3)) + np.array([0.0, 0.0, -9.8])
    still = inspect_samples(ImuData(t, np.zeros((len(t), 3)), accel), (0.0, 100.0))
    assert still.jolt[0] == 0.0
    accel[(t >= 40.0) & (t < 41.0), 1] += 0.05
    found = inspect_samples(ImuData(t, np.zeros((len(t), 3)), accel), (0.0, 100.0)).jolt
    assert found[0] == pytest.approx(0.05, rel=0.1)
    assert found[1] in (40.0, 41.0)


def test_two_rows_of_a_place_are_a_reference_between_them():
    row = np.array([[0.6, 1.9, 380.0]])
    ends = Trajectory(np.array([0.0, 100.0]), np.tile(row, (2, 1)), np.zeros((2, 3)), np.full((2, 3), np.nan))
    times = np.arange(1.0, 99.0)
    held = _held(ends, times)
    assert np.array_equal(held.time, times)
    assert np.array_equal(held.lla, np.tile(row, (98, 1)))
    moved = replace(ends, lla=np.vstack([row, row + 1e-6]))
    for other in (moved, replace(ends, time=ends.time + 50.0)):
        assert _held(other, times) is other


def test_samples_too_far_apart_are_refused(tmp_path):
    gps = table(tmp_path / "gps.csv", fixes(GPS_HEADERS))
    rows = [(name, cells[::50]) for name, cells in samples(IMU_HEADERS)]
    with pytest.raises(InputError, match=r"columns.time"):  # the header may be wrong
        insnav.load(table(tmp_path / "slow.csv", rows), gps)
    with pytest.raises(InputError, match=r"imu.too_slow"):
        insnav.load(table(tmp_path / "dated.csv", [("time", iso()(drive().t[::50])), *rows[1:]]), gps)


def test_fixes_that_contradict_themselves_are_counted(made):
    gps = made.gps.data
    sound = look_at_fixes(gps)
    assert (sound.false_velocities, sound.jumps) == (0.0, 0)
    noise = np.random.default_rng(3).normal(0.0, 0.5, len(gps.time)) / 6.37e6
    noisy = look_at_fixes(replace(gps, lla=gps.lla + np.column_stack([noise, 0.0 * noise, 0.0 * noise])))
    assert noisy.scatter[0] == pytest.approx(0.5, rel=0.1)
    v_n = gps.v_n.copy()
    wrong = np.arange(300, 1200, 30)
    v_n[wrong, 0] += 6.0
    found = look_at_fixes(replace(gps, v_n=v_n))
    assert found.false_velocities == pytest.approx(len(wrong) / len(gps.time), rel=0.1)
    assert found.worst_velocity == pytest.approx(6.0, abs=0.5)
    lla = gps.lla.copy()
    lla[700:, 0] += 30.0 / 6.37e6
    found = look_at_fixes(replace(gps, lla=lla))
    assert found.jumps == 1
    assert found.largest_jump == pytest.approx(30.0, abs=0.5)


def test_jumps_of_fixes_that_are_as_poor_as_they_say_are_counted(made):
    rough = made.gps.data.rows(slice(None, None, 4))
    noise = np.random.default_rng(3).normal(0.0, 1.5, (len(rough.time), 2)) / 6.37e6
    sd = np.full((len(rough.time), 3), 1.5)
    lla = rough.lla + np.column_stack([noise, np.zeros(len(rough.time))])
    assert look_at_fixes(replace(rough, lla=lla, position_sd=sd)).jumps == 0
    lla[100:300:40, 0] += 20.0 / 6.37e6
    found = look_at_fixes(replace(rough, lla=lla, position_sd=sd))
    assert found.jumps == 10  # there and back
    assert found.largest_jump == pytest.approx(20.0, abs=5.0)


def test_a_logger_on_a_clock_of_its_own_turned_over(tmp_path):
    imu = table(tmp_path / "log.csv", samples(SHORT, lambda t: text((t - 408_123.45) * 1e3, 0), matrix=FLU))
    gps = table(tmp_path / "rtk.csv", fixes(GPS_HEADERS))
    found = check(gps, imu).found
    assert found.roles == {str(gps): "GPS", str(imu): "IMU"}
    words = found.command.split()
    assert words[:5] == ["insnav", "run", str(imu), "--gps", str(gps)]
    assert float(words[words.index("--imu-time-offset") + 1]) == pytest.approx(408_123.45, abs=0.1)
    assert words[words.index("--imu-axes") + 1] == "FLU"
    first = found.problems[0]
    assert first.code is Code.CHECK_OPTION_NEEDED
    assert first["cause"].code == "clock.no_common_time"
    assert found.run is not None


def test_what_cannot_be_read_is_the_first_to_mend(tmp_path):
    bad = tmp_path / "a.csv"
    bad.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    gps = table(tmp_path / "gps.csv", fixes(GPS_HEADERS))
    found = check(bad, gps).found
    assert found.problems[0].code is Code.CHECK_REFUSED
    assert found.problems[0]["cause"].code == "format.unknown"
    assert found.problems[0]["cause"].where == str(bad)
    assert not found.runs
    imu = table(tmp_path / "imu.csv", samples(IMU_HEADERS))
    alone = check(imu).found
    assert alone.imu is not None
    assert "session.no_gps" in [each["cause"].code for each in of_code(alone.problems, Code.CHECK_REFUSED)]
    assert np.isclose(alone.imu.axes[5].at_rest, drive().accel[:200, 2].mean(), atol=0.05)


def test_what_refusals_ask_for_stands_in_a_line_that_runs(tmp_path):
    gyro = ",".join(f"w{axis} [rad/s]" for axis in "xyz")
    imu = table(tmp_path / "imu.csv", samples(f"time_s,{gyro},fx,fy,fz", gyro=DEG))  # they are deg/s
    exchanged = GPS_HEADERS.replace("lat_deg,lon_deg", "lon_deg,lat_deg")
    found = check(imu, table(tmp_path / "gps.csv", fixes(exchanged))).found
    assert found.runs
    assert not found.runs_as_given
    assert "--imu-units gyro=deg/s" in found.command
    assert "--gps-columns lat=lon_deg,lon=lat_deg" in found.command
    bare = table(tmp_path / "gps.txt", fixes(GPS_HEADERS), header=False)
    found = check(bare, table(tmp_path / "good.csv", samples(IMU_HEADERS))).found
    assert found.runs
    assert "--gps-columns time=1,lat=2,lon=3,height=4" in found.command


def test_columns_of_names_that_say_nothing_are_told_by_what_they_hold(tmp_path):
    imu = table(tmp_path / "log.csv", samples("t,wa,wb,wc,fa,fb,fc"))
    gps = table(tmp_path / "gps.csv", fixes(GPS_HEADERS))
    (tmp_path / "list.csv").write_text("name,speed\na,1\nb,2\n")
    found = check(tmp_path).found
    assert found.roles == {str(imu): "IMU", str(gps): "GPS", str(tmp_path / "list.csv"): "not understood"}
    assert found.runs
    assert found.command.endswith("--columns gyro_x=wa,gyro_y=wb,gyro_z=wc,accel_x=fa,accel_y=fb,accel_z=fc")
    nothing = check(tmp_path / "list.csv").found
    assert list(nothing.roles.values()) == ["not understood"]
    assert "name, speed" in sentence(nothing.problems[0])


def test_files_that_are_cut_off_or_cover_a_part_are_said(tmp_path):
    imu, gps = table(tmp_path / "imu.csv", samples(IMU_HEADERS)), table(tmp_path / "gps.csv", fixes(GPS_HEADERS))
    whole = imu.read_bytes()
    codes = (
        Code.ROWS_CUT,
        Code.FILES_IMU_ENDS_EARLY,
        Code.FILES_GPS_ENDS_EARLY,
        Code.FILES_IMU_BEGINS_LATE,
        Code.FILES_GPS_BEGINS_LATE,
    )
    assert not [*of_code(check(imu, gps).found.problems, *codes)]
    imu.write_bytes(whole[: len(whole) // 2])
    cut, short = of_code(check(imu, gps).found.problems, *codes)
    result = insnav.load(imu, gps).navigate()
    assert (cut.code, cut.subject, cut["file"]) == (Code.ROWS_CUT, "imu", "imu.csv")
    assert (short.code, short["file"], short["other"]) == (Code.FILES_IMU_ENDS_EARLY, "imu.csv", "gps.csv")
    assert short["lost_s"] == result.inputs["gps"].end_s - result.inputs["imu"].end_s
    for each in (cut, short):
        assert any(sentence(each) in text for text in result.page().warnings)


def test_a_reference_that_is_the_fixes_is_said(tmp_path):
    imu, gps = table(tmp_path / "imu.csv", samples(IMU_HEADERS)), table(tmp_path / "gps.csv", fixes(GPS_HEADERS))
    result = check(imu, gps, table(tmp_path / "ref.csv", fixes(GPS_HEADERS[:34])))
    assert Code.CHECK_SAME_DATA in {each.code for each in result.found.problems}
    found = insnav.load(imu, gps, gps).navigate(smooth=False).found
    assert found.reference_is_gps
    assert Code.REF_SAME_AS_GPS in [each.code for each in run_warnings(found)]
    apart = fixes(GPS_HEADERS, height=text(drive().lla[:, 2] + 0.1), lat=text(drive().lla[:, 0] + 1e-7, 10))
    other = table(tmp_path / "other.csv", apart)
    assert not insnav.load(imu, gps, other).navigate(smooth=False).found.reference_is_gps


def test_files_of_other_drives_are_not_taken_for_parts_of_this_one(tmp_path):
    """A second IMU file was called GPS or reference, and the last of several references taken."""
    names = {
        "a.csv": "imu.csv.gz",
        "b.csv": "imu.csv.gz",
        "gps.csv": "gps.csv",
        "ref.csv": "ref.csv",
        "ref_2.csv": "ref.csv",
    }
    for name, source in names.items():
        (tmp_path / name).write_bytes((SAMPLE / source).read_bytes())
    found = check(*(tmp_path / name for name in names)).found
    roles = {path.rsplit("/", 1)[-1]: role for path, role in found.roles.items()}
    assert roles == {
        "a.csv": "IMU",
        "b.csv": "another IMU: not checked",
        "gps.csv": "GPS",
        "ref.csv": "reference",
        "ref_2.csv": "another reference: not checked",
    }


def test_a_filter_that_is_lost_is_no_run(tmp_path, monkeypatch):
    lost = Finding.of(Code.RUN_REJECTED, share=0.99)
    monkeypatch.setattr("insnav.session.check.failure", lambda run: lost)
    imu, gps = table(tmp_path / "imu.csv", samples(IMU_HEADERS)), table(tmp_path / "gps.csv", fixes(GPS_HEADERS))
    found = check(imu, gps).found
    assert not found.runs
    assert not found.runs_as_given
    assert found.problems[0].severity is Severity.UNUSABLE
    assert found.problems[0]["cause"].values == (("cause", lost),)


def test_a_folder_with_an_imu_model_beside_the_samples_is_one_recording(tmp_path):
    table(tmp_path / "imu.csv", samples(IMU_HEADERS))
    table(tmp_path / "gps.csv", fixes(GPS_HEADERS))
    (tmp_path / "imu.toml").write_text("[gyro]\n")
    assert check(tmp_path).found.runs_as_given


def test_fixes_alone_are_examined(tmp_path):
    found = check(table(tmp_path / "gps.csv", fixes(GPS_HEADERS))).found
    assert found.gps is not None
    assert not found.runs
    assert found.problems[0].code is Code.CHECK_REFUSED


def test_page_text_and_json(tmp_path):
    imu = table(tmp_path / "imu.csv", samples(IMU_HEADERS))
    gps = table(tmp_path / "gps.csv", fixes(GPS_HEADERS))
    result = check(imu, gps)
    assert result.summary().rstrip().splitlines()[-1] == f"run:  insnav run {imu} --gps {gps}"
    where = result.save(tmp_path / "out")
    facts = json.loads((where / "run.json").read_text())
    assert facts["kind"] == "check"
    assert facts["mend"]["command"].startswith("insnav run")
    assert set(facts) >= {"files", "imu", "gps", "together", "mend"}
    assert (where / "report.html").is_file()
    assert list(result.to_frame().columns) == ["what", "why", "fix"]


def test_the_place_of_a_bench_is_no_fix(tmp_path):
    made = drive()
    rest = made.t < made.t[0] + 5.0
    rows = [(name, cells[: int(rest.sum())]) for name, cells in samples(IMU_HEADERS)]
    ends = [
        text(np.array([made.t[0] - 1.0, made.t[0] + 60.0]), 3),
        *([each[0]] * 2 for _, each in fixes(GPS_HEADERS)[1:4]),
    ]
    ends += [["0.0", "0.0"]] * 3
    ref = table(tmp_path / "ref.csv", list(zip(GPS_HEADERS.split(","), ends, strict=False)))
    found = check(table(tmp_path / "imu.csv", rows), ref).found
    assert found.roles[str(ref)] == "reference"
    assert [each["cause"].code for each in of_code(found.problems, Code.CHECK_REFUSED)] == ["align.no_heading"]


def test_velocities_that_are_not_there_have_no_figures() -> None:
    time = np.arange(60.0)
    lla = np.stack([np.full(60, 0.8), 0.2 + 1e-7 * time, np.full(60, 300.0)], axis=1)
    found = look_at_fixes(GpsData(time, lla, np.full((60, 3), np.nan), np.full((60, 3), 2.0), np.full((60, 3), np.nan)))
    assert found.jumps is None
    assert np.isnan([found.velocity_lag, found.velocity_lag_sd, found.false_velocities, found.worst_velocity]).all()


def test_noise_of_the_fixes_is_not_speed() -> None:
    time, rng = np.arange(0.0, 400.0, 0.2), np.random.default_rng(1)
    bend = np.cumsum(np.where(time % 100.0 < 40.0, 0.02, 0.0)) * 0.2
    north, east = (
        np.cumsum(13.9 * 0.2 * each) + rng.normal(0.0, 0.7, time.size) for each in (np.cos(bend), np.sin(bend))
    )
    lla = np.stack([0.8 + north / 6.37e6, 0.2 + east / 6.37e6 / np.cos(0.8), np.full(time.size, 300.0)], axis=1)
    none = np.full((time.size, 3), np.nan)
    assert look_at_fixes(GpsData(time, lla, none, none, none)).largest_speed == pytest.approx(13.9, abs=1.0)
    outage = (time < 100.0) | (time > 160.0)
    found = look_at_fixes(GpsData(time, lla, none, none, none).rows(outage))
    assert found.largest_speed == pytest.approx(13.9, abs=1.0)


def test_axes_that_the_check_tries_are_not_called_given(tmp_path) -> None:
    path = table(tmp_path / "log.csv", samples(SHORT, lambda t: text((t - 408_123.45) * 1e3, 0), matrix=FLU))
    for options, given in (({}, False), ({"axes": "FLU"}, True)):
        result = check(path, **options)
        assert any(of_code(result.inputs["imu"].evidence, Code.AXES_GIVEN)) == given
        refusals = of_code(result.found.problems, Code.CHECK_OPTION_NEEDED)
        assert ("columns.axes_flu" in [each["cause"].code for each in refusals]) == (not given)


def test_what_the_run_takes_care_of_is_no_mend():
    kept = Finding.of(Code.CHECK_FALSE_VELOCITIES, share=0.007, speed_m_s=4.0)
    refused = Finding.of(Code.CHECK_REFUSED, cause=InputError("session.no_gps").facts)
    found = Checked({}, "insnav run log.bin", (refused, kept))
    lines = Result("check", found).summary().splitlines()
    assert [line.split(":")[0] for line in lines if line][-2:] == ["mend 1", "run"]


def test_every_problem_has_its_place():
    """A code of the check without one would be a crash where it is found."""
    assert {code for code in Code if code.startswith("check.")} <= set(WORST_FIRST)
    assert len(set(WORST_FIRST)) == len(WORST_FIRST)
