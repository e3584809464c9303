"""Consumer MEMS IMU started in motion, against a fibre-optic INS; fixes are made from the latter.

The MEMS axes are those of the reference turned by the rotation vector of the author's solution,
``C_n_mems = C_n_reference exp([mu x])``; his program takes `mu` off the MEMS attitude from the right before it
compares. `mu` is in right-forward-up axes; these turn into forward-right-down by a proper rotation, under which a
rotation vector changes its components as any vector does: the first two change places, the third its sign.
"""

from __future__ import annotations

import numpy as np
import pytest

from insnav.attitude import quat_from_rotvec, quat_from_rph, quat_multiply, rph_from_quat
from insnav.earth import lla_offset
from insnav.errors.metrics import position_errors
from insnav.filter.navigate import Navigated
from insnav.imu import load_imu
from insnav.input import read_imu, read_reference
from insnav.types import FloatArray, GpsData, ImuData, Trajectory
from tests.recorded.recording import navigated
from tests.shared import recorded

NAME = "psins_fog_mems_100s"
SEEDS = range(6)
GPS_SD = 1.0  # [m]
SETTLED = 30.0  # [s]
MOUNTING = (-5.3, 2.5, -17.6)  # right, forward, up [arcmin]
GYRO_BIAS = (-214.0, 159.0, 84.0)  # right, forward, up [deg/h]


@pytest.fixture(scope="module")
def reference() -> Trajectory:
    read = read_reference(recorded(NAME) / "ref.csv").data
    mu = np.radians(frd(MOUNTING)) / 60.0
    rph = rph_from_quat(quat_multiply(quat_from_rph(read.rph), quat_from_rotvec(mu)))
    return Trajectory(read.time, read.lla, read.v_n, rph)


@pytest.fixture(scope="module")
def runs(reference: Trajectory) -> list[Navigated]:
    imu: ImuData = read_imu(recorded(NAME) / "imu.csv").data
    spec = load_imu("consumer")  # there is no rest to find it from
    return [navigated(imu, fixes(reference, seed), spec) for seed in SEEDS]


def test_attitude_errors_are_inside_three_sd(runs: list[Navigated], reference: Trajectory) -> None:
    inside = []
    for seed, done in zip(SEEDS, runs, strict=True):
        errors = position_errors(done.run.solution, reference)
        assert errors.sd is not None
        error, sd = np.degrees(errors.attitude), np.degrees(errors.sd[:, 6:])
        counted = errors.time > reference.time[0] + SETTLED
        inside.append(np.abs(error[counted]) <= 3.0 * sd[counted])
        print(f"seed {seed}: at the end error {error[-1].round(3)}, sd {sd[-1].round(3)} deg")
        assert sd[-1, 0] < 0.7
        assert sd[-1, 1] < 1.2  # that of the bias alone: the drive hardly turns
    share = np.concatenate(inside).mean(axis=0)
    print(f"inside 3 sd: roll, pitch, heading {(100.0 * share).round(1)} % of {sum(map(len, inside))} epochs")
    assert sum(map(len, inside)) > 500
    assert (share >= 0.99).all()


def test_roll_and_pitch_are_accurate_at_the_end(runs: list[Navigated], reference: Trajectory) -> None:
    for done in runs:
        errors = position_errors(done.run.solution, reference)
        roll, pitch, heading = np.degrees(errors.attitude[-1])
        assert abs(roll) < 0.3
        assert abs(pitch) < 1.2
        assert abs(heading) < 8.0


def test_gyro_biases_agree_with_those_of_the_author(runs: list[Navigated]) -> None:
    expected = frd(GYRO_BIAS)
    for seed, done in zip(SEEDS, runs, strict=True):
        found = done.run.sensor_errors
        value, sd = (np.degrees(v[-1, :3]) * 3600.0 for v in (found.value, found.sd))
        print(f"seed {seed}: gyro bias {value.round(0)}, sd {sd.round(0)}, expected {expected.round(0)} deg/h")
        assert (np.abs(value - expected)[:2] < 3.0 * sd[:2]).all()
        assert (sd[:2] < 100.0).all()


def frd(right_forward_up: tuple[float, float, float]) -> FloatArray:
    right, forward, up = right_forward_up
    return np.array([forward, right, -up])


def fixes(reference: Trajectory, seed: int) -> GpsData:
    """Positions once a second with white noise."""
    rows = np.flatnonzero(np.abs(reference.time - np.round(reference.time)) < 1e-3)
    shape = (len(rows), 3)
    noise = GPS_SD * np.random.default_rng(seed).standard_normal(shape)
    nan = np.full(shape, np.nan)
    return GpsData(reference.time[rows], lla_offset(reference.lla[rows], noise), nan, np.full(shape, GPS_SD), nan)
