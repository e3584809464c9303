"""A drive whose record begins in motion: after smoothing, its first minute is as good as the rest."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import insnav
from insnav.alignment.in_motion import sure_motion
from insnav.attitude import wrap_pi
from insnav.earth import A, ned_offset
from insnav.filter.delay_and_lever import filtered
from insnav.filter.navigate import navigate_recording
from insnav.filter.prepare import prepare
from insnav.filter.receiver import DELAY_SD, Delay, LeverArm, Receiver
from insnav.findings import Code, of_code
from insnav.input import read_gps, read_imu
from insnav.session.simulation import plan_of, profiled
from insnav.simulate import GpsErrors, reference
from insnav.types import GpsData, ImuData, Trajectory
from insnav.units import DEG
from tests.filter import drives
from tests.shared import recorded
from tests.simulate.motions import Segment, drive, measured

LAPS = 4
FIRST = 60.0  # [s]


def begun_in_motion(seed: int, laps: int = LAPS) -> tuple[ImuData, GpsData]:
    """Record of a drive from the middle of a stretch at 14 to 19 m/s on."""
    rng = np.random.default_rng([17, seed])
    imu = drives.noisy_imu(drives.perfect_imu(laps=laps), drives.MODEL, rng)
    gps = drives.noisy_gps(drives.perfect_gps(laps=laps), rng)
    begin = imu.time[0] + 12.0 + 2.0 * seed
    i, g = np.searchsorted(imu.time, begin), gps.time > begin
    imu = ImuData(imu.time[i:], imu.gyro[i:], imu.accel[i:], imu.sampling, imu.stamp)
    return imu, GpsData(gps.time[g], gps.lla[g], gps.v_n[g], gps.position_sd[g], gps.velocity_sd[g])


def squares(solution: Trajectory) -> np.ndarray:
    """Mean squared horizontal and heading error, of the first minute and of the rest, and of heading by its sd."""
    true = reference(drives.truth(LAPS), solution.time)
    heading = wrap_pi(solution.rph[:, 2] - true.rph[:, 2])
    assert solution.sd is not None
    found = np.column_stack(
        [
            np.sum(ned_offset(solution.lla, true.lla)[:, :2] ** 2, axis=1),
            heading**2,
            (heading / solution.sd[:, 8]) ** 2,
        ]
    )
    early = solution.time < solution.time[0] + FIRST
    return np.array([found[early].mean(axis=0), found[~early].mean(axis=0)])


def test_the_first_minute_of_a_moving_start_is_as_good_as_the_rest_after_smoothing():
    forward, smoothed = [], []
    for seed in range(6):
        imu, gps = begun_in_motion(seed)
        run = navigate_recording(imu, gps, drives.SPEC, Receiver(LeverArm(drives.LEVER_B), Delay(sd=0.0))).run
        assert run.alignment.static is None
        assert run.smoothed is not None
        forward.append(squares(run.solution))
        smoothed.append(squares(run.smoothed.solution))
    early, rest = np.sqrt(np.mean(forward, axis=0))
    early_smoothed, rest_smoothed = np.sqrt(np.mean(smoothed, axis=0))
    print("filter, horizontal [m], heading [rad]:", early, rest, "smoothed:", early_smoothed, rest_smoothed)
    assert early[1] > 3.0 * rest[1]  # otherwise there is nothing to show
    assert early_smoothed[0] < 1.2 * rest_smoothed[0]
    assert early_smoothed[1] < 1.2 * rest_smoothed[1]
    assert early_smoothed[2] < 1.5


@pytest.mark.parametrize(("grade", "seed"), [("automotive", 415), ("consumer", 602)])
def test_a_lever_arm_is_not_seen_in_an_attitude_that_is_corrected_on_the_way(grade, seed):
    """Three minutes by RTK from a moving start: the arm was 22 and 6 of its sd off, 43 and 55 % inside 3 sd."""
    made = plan_of(profiled("round_trip", seed), {"imu": grade, "gps": "rtk", "seed": seed}).measured()
    run = insnav.load(made.imu, gps=made.gps).navigate().found.run
    assert run.alignment.static is None
    assert np.max(np.abs(run.lever_b) / run.lever_sd) < 3.0
    solution = run.smoothed.solution
    true = np.column_stack([np.interp(solution.time, made.reference.time, each) for each in made.reference.lla.T])
    assert np.mean(np.abs(ned_offset(solution.lla, true)) < 3.0 * solution.sd[:, :3]) > 0.97


def test_the_attitude_at_the_start_is_that_of_its_own_fix():
    """Of long drives only some fixes are looked at: where that of the start was none, a ship was rolled by 8 deg."""
    imu, gps = begun_in_motion(1, laps=10)
    imu = imu.rows(imu.time > gps.time[0] + 0.3)  # the second fix is the first that it covers
    ready, _ = prepare(imu, gps, drives.SPEC, Receiver(LeverArm(drives.LEVER_B), Delay(sd=DELAY_SD)))
    seen = filtered(ready).ready
    assert seen.gps.time.size < gps.time.size
    assert seen.alignment.level_method is Code.ALIGN_LEVEL_MOTION_FILTER
    assert seen.initial.time == seen.alignment.time == ready.alignment.time


@pytest.mark.parametrize("bias", [-0.7, 0.2, 0.5])
def test_a_straight_road_tells_the_gyro_bias_by_the_course(bias):
    """Five minutes on, by positions alone, without a rest: heading was up to 35 deg off, with 8 stated."""
    truth = drive((Segment(3.0), Segment(9.0, speed=28.0), Segment(300.0)), drives.PLACE, seed=1, heading=0.4)
    receiver = GpsErrors((0.3, 0.3, 0.5), (1.5, 1.5, 2.5), 150.0)
    imu, gps = measured(truth, 50.0, "consumer", receiver, 3)
    turned = replace(imu, gyro=imu.gyro - imu.gyro[:100].mean(axis=0) + np.array([0.1, -0.1, bias]) * DEG / 50.0)
    turned = turned.rows(turned.time > 6.0)
    run = insnav.load(turned, drives.without_velocities(gps)).navigate().found.run
    assert run.alignment.static is None
    track = run.smoothed.solution.rows(run.smoothed.solution.time < 310.0)
    wrong = wrap_pi(track.rph[:, 2] - reference(truth, track.time).rph[:, 2])
    assert np.sqrt(np.mean(wrong**2)) < 8.0 * DEG
    assert np.mean(np.abs(wrong) < 3.0 * track.sd[:, 8]) > 0.97


@pytest.mark.parametrize("begin", [88.0, 151.0, 209.0, 222.0])
def test_the_heading_of_a_recorded_piece_begun_in_motion_is_as_sure_as_it_says(begin):
    """Three quarters of a minute by RTK, against the whole drive by four times as many fixes a second."""
    imu, gps, whole = recorded_drive()
    some = (imu.time >= imu.time[0] + begin) & (imu.time < imu.time[0] + begin + 45.0)
    inside = np.flatnonzero((gps.time >= imu.time[0] + begin) & (gps.time < imu.time[0] + begin + 45.0))
    run = insnav.load(imu.rows(some), gps.rows(inside[::4])).navigate().found.run
    assert run.alignment.static is None
    assert run.smoothed is not None
    track = run.smoothed.solution
    wrong = wrap_pi(track.rph[:, 2] - np.interp(track.time, whole.time, np.unwrap(whole.rph[:, 2])))
    assert np.mean(np.abs(wrong) < 3.0 * track.sd[:, 8]) > 0.97
    assert np.sqrt(np.mean(wrong**2)) < 2.5 * DEG


@lru_cache(maxsize=1)
def recorded_drive() -> tuple[ImuData, GpsData, Trajectory]:
    folder = recorded("rtklib_drive_20250708")
    imu, gps = read_imu(folder / "imu.csv.gz").data, read_gps(folder / "gps.csv").data
    smoothed = insnav.load(imu, gps).navigate().found.run.smoothed
    return imu, gps, smoothed.solution


CREEPING = """
purpose = "a rover that is never faster than 0.36 m/s, whose IMU shakes"
[start]
lat = "48 deg"
lon = "11 deg"
heading = "40 deg"
speed = "{speed} m/s"
[[vibration.engine]]
frequency = "12 Hz"
acceleration = "0.5 m/s^2"
{rest}
[[segment]]
kind = "repeat"
count = 3
segment = [
  {{ kind = "cruise", duration = "60 s" }},
  {{ kind = "turn", angle = "80 deg", rate = "6 deg/s" }},
  {{ kind = "cruise", duration = "60 s" }},
  {{ kind = "turn", angle = "-60 deg", rate = "6 deg/s" }},
]
"""
POOR = """
name = "poor"
rate = "1 Hz"
fix = 5
[position]
white = "2.5 m"
lasting = "2.5 m"
correlation_time = "100 s"
[velocity]
white = "0.05 m/s"
"""
REST = """
[[segment]]
kind = "static"
duration = "60 s"
[[segment]]
kind = "accelerate"
to = "0.36 m/s"
"""


@pytest.mark.parametrize("rests", [True, False])
def test_a_creeping_vehicle_is_aligned_by_its_course(tmp_path: Path, rests: bool):
    """0.36 m/s is seven sd of the velocities: it was refused below a fixed 0.7 m/s."""
    (tmp_path / "rover.toml").write_text(CREEPING.format(speed=0.0 if rests else 0.36, rest=REST if rests else ""))
    (tmp_path / "poor.toml").write_text(POOR)
    drive = insnav.simulate(tmp_path / "rover.toml", imu="industrial", gps=tmp_path / "poor.toml", seed=1)
    aligned = drive.until("align")
    ready = aligned.ready
    true = np.interp(ready.initial.time, drive.reference.data.time, np.unwrap(drive.reference.data.rph[:, 2]))
    assert abs(wrap_pi(ready.alignment.rph[2] - true)) < 3.0 * ready.alignment.sd[2]
    assert ready.alignment.sd[2] < np.radians(31.0)
    assert any(of_code(aligned.model.findings, Code.ALIGN_HEADING_CREEPING)) is not rests
    assert (ready.alignment.static is not None) is rests


@pytest.mark.parametrize(("noise", "stated", "lasts"), [(0.05, 0.05, 0.0), (0.05, 0.0125, 10.0), (0.08, 0.02, 60.0)])
def test_velocities_at_rest_are_no_motion_even_if_they_are_worse_than_stated(noise: float, stated: float, lasts: float):
    n, rng = 900, np.random.default_rng(5)
    for _ in range(20):
        v, share = rng.normal(size=(n, 3)) * noise, np.exp(-1.0 / lasts) if lasts else 0.0
        for row in range(1, n):
            v[row] = share * v[row - 1] + np.sqrt(1.0 - share**2) * v[row]
        lla = np.array([0.8, 0.2, 0.0]) + rng.normal(size=(n, 3)) * [1.5 / A, 1.5 / A, 3.0]
        gps = GpsData(np.arange(n) + 0.0, lla, v, np.full((n, 3), 1.5), np.full((n, 3), stated))
        assert sure_motion(gps, 0.0)[1] is None
