"""Car with a consumer MEMS IMU and an RTK receiver; its own fixes are the reference, as none is of higher grade."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.attitude import wrap_pi
from insnav.earth import ned_offset
from insnav.filter.gps_noise import velocity_lag
from insnav.filter.navigate import Navigated
from insnav.findings import Code, of_code
from insnav.types import GpsData
from tests.filter.drives import without_velocities
from tests.recorded.recording import imu_model, navigated, recording, rms
from tests.shared import recorded

NAME = "rtklib_drive_20250708"
LEVER_ARM = (0.0, -0.05, 0.0)
IMU_TURNED = 5.35  # in the car, clockwise from its nose, by the author of the recording [deg]


@pytest.fixture(scope="module")
def gps() -> GpsData:
    return recording(NAME)[1]


@pytest.fixture(scope="module")
def done() -> Navigated:
    imu, gps = recording(NAME)
    return navigated(imu, gps, imu_model(imu, gps), LEVER_ARM)


def test_heading_converges_without_being_told(done: Navigated, gps: GpsData) -> None:
    solution = done.run.solution
    assert solution.sd is not None
    late = solution.time > solution.time[0] + 120.0
    axes = 0.01  # of the preset: how far the sensors are turned in the IMU, which no convergence makes smaller [rad]
    worst = np.degrees(np.sqrt(solution.sd[late, 8].max() ** 2 - axes**2))
    course, straight = straight_course(gps)
    straight &= gps.time > solution.time[0] + 120.0
    heading = solution.rph[np.searchsorted(solution.time, gps.time[straight]), 2]
    apart = np.degrees(wrap_pi(heading - course[straight]))
    print(f"heading sd after 120 s at most {worst:.2f} deg; heading - course on {straight.sum()} straight fast fixes:")
    print(f"median {np.median(apart):.2f}, sd {apart.std():.2f}, from {apart.min():.2f} to {apart.max():.2f} deg")
    assert straight.sum() > 300
    assert worst < 1.0
    assert np.median(apart) == pytest.approx(IMU_TURNED, abs=1.0)
    assert apart.std() < 1.0
    assert np.abs(apart - IMU_TURNED).max() < 3.0


def test_clock_offset_is_found_within_what_is_known_of_it(done: Navigated) -> None:
    # three ways of measuring it agree to +-0.06 s only; those that use position want GPS 0.04 to 0.07 s later
    assert -0.11 < done.run.gps_delay < -0.04
    assert 0.0 < done.run.gps_delay_sd < 0.01


@pytest.mark.parametrize("late", [0.4, -0.6])
def test_precise_positions_alone_tell_the_clock_as_those_with_velocities_do(late: float) -> None:
    """Their delay was "not told", the arm 0.9 m off with 0.06 stated, heights 0.9 m; the filter took most for false."""
    folder = recorded(NAME)
    drive = insnav.load(folder / "imu.csv.gz", folder / "gps.csv")
    fixes = without_velocities(drive.gps.data)
    fixes = replace(fixes, time=fixes.time + late)
    recording = replace(drive.recording, gps=replace(drive.recording.gps, data=fixes), fixes=fixes)
    drive = replace(drive, recording=recording)
    run = drive.navigate(output_interval=1.0).found.run
    print(f"delay {run.gps_delay:.3f} s, sd {run.gps_delay_sd:.3f} s; arm {run.lever_b.round(2)} m")
    # with velocities it is 0.071 s before the timestamps are moved
    assert run.gps_delay == pytest.approx(late - 0.071, abs=0.01)
    assert run.gps_delay_sd < 0.02  # doubled: noise of these gyros hides it
    np.testing.assert_allclose(run.lever_b, LEVER_ARM, atol=0.12)


def test_velocities_are_found_to_be_means_since_the_fix_before(done: Navigated, gps: GpsData) -> None:
    lag, sd = velocity_lag(gps)
    half_interval = 0.5 * float(np.median(np.diff(gps.time)))
    print(f"velocity older than position by {lag:.4f} s, sd {sd:.4f} s; half the interval of fixes {half_interval} s")
    assert lag == pytest.approx(half_interval, abs=0.02)
    assert any(of_code(done.notes, Code.GPS_VELOCITY_LAG))


def test_position_innovations_are_below_those_of_gps_alone(done: Navigated, gps: GpsData) -> None:
    alone = rms(constant_velocity_innovations(gps))
    offered = done.run.innovations
    ours = rms(offered.innovation[offered.used_position, :3])
    print(f"position innovations RMS N/E/D: {ours.round(4)} m, constant velocity by GPS alone {alone.round(4)} m")
    assert (ours < alone).all()
    assert (ours[:2] < 0.5 * alone[:2]).all()


def test_innovations_have_their_predicted_size(done: Navigated) -> None:
    offered = done.run.innovations
    assert 0.7 < offered.nis_position[offered.used_position].mean() / 3.0 < 1.4


def test_with_nothing_configured_innovations_have_their_predicted_size() -> None:
    """Noise that was found in fixes a second apart is right for those of a quarter of a second, too: .71 were not."""
    folder = recorded(NAME)
    offered = insnav.load(folder / "imu.csv.gz", gps=folder / "gps.csv").navigate().found.run.innovations
    for nis, used in ((offered.nis_position, offered.used_position), (offered.nis_velocity, offered.used_velocity)):
        assert 0.8 < nis[used & np.isfinite(nis)].mean() / 3.0 < 1.2


def test_hardly_any_fix_is_rejected(done: Navigated) -> None:
    offered = done.run.innovations
    assert len(offered.time) > 2100
    assert np.mean(~offered.used_position) < 0.01
    assert np.mean(~offered.used_velocity[np.isfinite(offered.nis_velocity)]) < 0.01


def straight_course(gps: GpsData) -> tuple[np.ndarray, np.ndarray]:
    """Course at every fix from the positions around it, and where it is fast and turns less than 1 deg/s."""
    path = ned_offset(gps.lla, gps.lla[0])
    step = path[2:] - path[:-2]
    course = np.zeros(len(gps.time))
    course[1:-1] = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    straight = np.zeros(len(gps.time), dtype=bool)
    turn = (course[9:-1] - course[1:-9]) / (gps.time[9:-1] - gps.time[1:-9])
    straight[5:-5] = np.abs(np.degrees(turn)) < 1.0
    return course, straight & (np.hypot(gps.v_n[:, 0], gps.v_n[:, 1]) > 8.0)


def constant_velocity_innovations(gps: GpsData) -> np.ndarray:
    """Position minus the one predicted from the fix before and its velocity, where both are RTK fixes."""
    path = ned_offset(gps.lla, gps.lla[0])
    predicted = path[:-1] + gps.v_n[:-1] * np.diff(gps.time)[:, None]
    assert gps.fix is not None
    return (path[1:] - predicted)[(gps.fix[1:] == 1) & (gps.fix[:-1] == 1)]
