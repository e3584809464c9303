"""Small aircraft, 1 Hz GPS.

The filter on board, which the attitude is compared with, is of the same grade (15 states, the same IMU and GPS): no
truth, but written by others. Its heading is used in flight only. On the ground it is half a turn off what the gyros
say, integrated from flight back to the ground.
"""

from __future__ import annotations

import numpy as np
import pytest

import insnav
from insnav.attitude import quat_from_rotvec, quat_from_rph, quat_multiply, rph_from_quat, wrap_pi
from insnav.errors.metrics import TrajectoryErrors, position_errors
from insnav.filter.navigate import Navigated
from insnav.input import read_reference
from insnav.types import FloatArray, ImuData, Trajectory
from tests.recorded.recording import imu_model, navigated, recording, rms
from tests.shared import recorded

NAME = "umn_thor75_uav"
FLYING = 8.0  # [m/s]
IN_FLIGHT = 230.0  # level between two turns [s]
STILL = (110.0, 150.0)  # on the ground, shortly before the start [s]


@pytest.fixture(scope="module")
def on_board() -> Trajectory:
    return read_reference(recorded(NAME) / "onboard_nav" / "ref.csv").data


@pytest.fixture(scope="module")
def done() -> Navigated:
    imu, gps = recording(NAME)
    return navigated(imu, gps, imu_model(imu, gps))


@pytest.fixture(scope="module")
def errors(done: Navigated, on_board: Trajectory) -> TrajectoryErrors:
    return position_errors(done.run.solution, on_board)


def test_roll_and_pitch_agree_with_the_filter_on_board(errors: TrajectoryErrors) -> None:
    attitude = np.degrees(errors.attitude[:, :2])
    print(
        f"roll, pitch RMS {rms(attitude).round(2)} deg, in flight {rms(attitude[errors.speed > FLYING]).round(2)} deg"
    )
    assert len(attitude) > 33_000
    assert (rms(attitude) <= 2.0).all()


def test_heading_agrees_with_the_filter_on_board_in_flight(errors: TrajectoryErrors) -> None:
    heading = np.degrees(errors.attitude[errors.speed > FLYING, 2])
    low, median, high = np.percentile(heading, [5.0, 50.0, 95.0])
    print(f"heading at {len(heading)} epochs in flight: median {median:.2f} deg, 5 to 95 % {low:.1f} to {high:.1f} deg")
    assert len(heading) > 10_000
    assert np.median(np.abs(heading)) < 5.0
    assert max(-low, high) < 10.0


def test_heading_on_the_ground_is_what_the_gyros_say_from_flight_back(done: Navigated, on_board: Trajectory) -> None:
    start = on_board.rph[np.searchsorted(on_board.time, IN_FLIGHT)]
    time, rph = backwards(recording(NAME)[0], start)
    solution = done.run.solution
    for begin, end in (STILL, (30.0, 60.0)):
        span = (solution.time > begin) & (solution.time < end)
        by_gyros = rph[np.searchsorted(-time, -solution.time[span]), 2]
        apart = np.degrees(wrap_pi(solution.rph[span, 2] - by_gyros))
        theirs = on_board.rph[np.searchsorted(on_board.time, solution.time[span]), 2]
        print(f"{begin:.0f} to {end:.0f} s: heading - gyros {np.median(apart):.1f} deg, ", end="")
        print(f"on board - gyros {np.degrees(np.median(wrap_pi(theirs - by_gyros))):.1f} deg")
        assert np.abs(np.median(apart)) < 20.0


def backwards(imu: ImuData, rph: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times and attitudes from `IN_FLIGHT` back, by gyros less their mean at rest; good to some 10 deg."""
    bias = imu.gyro[(imu.time > STILL[0]) & (imu.time < STILL[1])].mean(axis=0)
    rows = np.flatnonzero(imu.time < IN_FLIGHT)[::-1]
    steps = quat_from_rotvec(-(imu.gyro[rows[:-1]] - bias) * -np.diff(imu.time[rows])[:, None])
    q = np.empty((len(rows), 4))
    q[0] = quat_from_rph(rph)
    for k, step in enumerate(steps):
        q[k + 1] = quat_multiply(q[k], step)
    return imu.time[rows], rph_from_quat(q)


def test_what_the_fixes_say_of_noise_is_looked_for_about_a_run_that_is_near() -> None:
    """With the preset the heading is 45 deg off after the first minutes: about that run all is noise."""
    folder = recorded(NAME)
    run = insnav.load(folder / "imu.csv.gz", gps=folder / "gps.csv").navigate().found.run
    used = run.innovations.used_velocity
    nis = np.mean((run.innovations.innovation[used, 3:] / run.innovations.sd[used, 3:]) ** 2)
    print(f"normalised innovations of velocity squared {nis:.2f}")
    assert 0.62 < nis < 1.2  # 0.59 about that run; 0.65 with the gyro that is off for a while, found since
    # with a gyro that was off, but not on the ground, standard deviations were 2.2 km, and 23 % of the fixes false
    assert run.smoothed.solution.sd[:, :2].max() < 3.0
    assert run.innovations.used_position.mean() > 0.98


def test_how_dense_the_solution_is_wanted_changes_no_decision() -> None:
    drive = insnav.load(recorded(NAME) / "imu.csv.gz", gps=recorded(NAME) / "gps.csv").beginning(240.0)
    dense, sparse = (drive.navigate(output_interval=every).found.run for every in (0.1, 1.0))
    assert len(dense.events) > 5
    assert [str(event) for event in sparse.events] == [str(event) for event in dense.events]
    for few, all_ in ((sparse.solution, dense.solution), (sparse.smoothed, dense.smoothed)):
        few, all_ = (getattr(each, "solution", each) for each in (few, all_))
        assert 9.0 < len(all_.time) / len(few.time) < 11.0
        np.testing.assert_array_equal(few.lla, all_.lla[np.searchsorted(all_.time, few.time)])
