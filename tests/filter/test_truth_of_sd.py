"""Nothing configured, data of an independent simulator (python-ins): errors are as large as stated.

What nobody gave is drawn from what is assumed of it: a lever arm of 1 m each axis, fixes late or early by 50 ms, half
of the variance of their positions lasting for a minute or two. With none of these errors would be smaller than stated.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, sosfiltfilt

import insnav
from insnav.attitude import wrap_pi
from insnav.earth import lla_offset, ned_offset
from insnav.imu import load_imu
from insnav.types import FloatArray, GpsData, ImuData, Run, Trajectory
from tests.shared import STANDARD_JOB

RATE, LENGTH, OUTAGE = 100, 420.0, (250.0, 310.0)  # [Hz], [s], [s]
LATE_SD, LASTING = 0.05, 100.0  # of the fixes, and for how long half of the variance of their positions lasts [s]
POSITION_SD, VELOCITY_SD = np.array([1.0, 1.0, 2.0]), np.array([0.05, 0.05, 0.1])
RTK = 0.02  # of that for the better IMUs
GRADES = "consumer", "tactical", "navigation"
TOO_LARGE, TOO_SMALL = 1.25, 0.4  # mean squared error by variance
SETTLED = 60.0  # after the start [s]


@pytest.fixture(scope="module")
def job() -> ModuleType:
    if not STANDARD_JOB.is_file():
        pytest.skip("the standard job is not beside the project (../shared/bench)")
    pytest.importorskip("pyins", reason="python-ins, which makes the truth, is not installed")
    spec = importlib.util.spec_from_file_location("standard_job", STANDARD_JOB)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)  # sets the Earth of python-ins to WGS-84
    return module


@dataclass(frozen=True)
class Recorded:
    """A drive, and what is true of it."""

    imu: ImuData
    gps: GpsData
    time: FloatArray  # (n,) of the truth [s]
    truth: FloatArray  # (n, 9) latitude, longitude [rad], height, velocity, attitude [rad]
    lever_b: FloatArray  # (3,) [m]
    late: float  # by which the fixes are stamped late [s]

    def normalised(self, track: Trajectory) -> FloatArray:
        """Errors by standard deviations of position, velocity and attitude, (k, 9), once a second, settled."""
        each = track.rows(np.flatnonzero((track.time > self.time[0] + SETTLED) & (track.time < self.time[-1] - 1.0)))
        # the solution is in the time of the fixes
        true = np.column_stack([np.interp(each.time - self.late, self.time, column) for column in self.truth.T])
        error = ned_offset(each.lla, true[:, :3]), each.v_n - true[:, 3:6], wrap_pi(each.rph - true[:, 6:])
        return (np.hstack(error) / each.sd)[:300]


_Motion = tuple[FloatArray, FloatArray, FloatArray]  # time (n,) [s], velocity (n, 3) [m/s], attitude (n, 3) [deg]


def of_the_job(job: ModuleType, moving: bool, seed: int) -> _Motion:
    """Seven minutes of the standard job."""
    time, v_n, rph, _ = job.motion(np.random.default_rng(seed), 340.0 + LENGTH + 60.0, RATE)
    first = int((340.0 if moving else 240.0) * RATE)
    return tuple(each[first : first + int(LENGTH * RATE) + 1] for each in (time, v_n, rph))


def motorway(seed: int, length: float) -> _Motion:
    """A car at about 30 m/s in wide bends, on a road that shakes it and turns it by 0.2 deg, up to 8 Hz."""
    rng, n = np.random.default_rng([seed, 5]), int(length * RATE) + 1
    time = np.arange(n) / RATE
    part = (time / 20.0).astype(int)
    speed = 30.0 + gaussian_filter1d(rng.uniform(-4.0, 4.0, part[-1] + 1)[part], 3.0 * RATE)
    turning = gaussian_filter1d(rng.uniform(-1.0, 1.0, part[-1] + 1)[part], RATE)

    def shaken(size: float, lowest: float, highest: float) -> FloatArray:
        road = butter(3, [lowest, highest], "band", fs=RATE, output="sos")
        return size * sosfiltfilt(road, rng.standard_normal(n)) / 0.35

    course = np.deg2rad(60.0 + np.cumsum(turning) / RATE)
    v_n = np.column_stack([speed * np.cos(course), speed * np.sin(course), shaken(0.08, 1.0, 14.0)])
    v_n[:, :2] += np.column_stack([shaken(0.015, 2.0, 12.0), shaken(0.015, 2.0, 12.0)])
    level = np.array([0.9, -1.6]) + np.column_stack([shaken(0.22, 0.5, 8.0), shaken(0.18, 0.5, 8.0)])
    return time, v_n, np.column_stack([level, np.rad2deg(course)])


def recorded(
    job: ModuleType, grade: str, moving: bool, seed: int, motion: _Motion | None = None, late: float | None = None
) -> Recorded:
    """A drive, with a minute without fixes: seven minutes of the standard job, or a `motion` that is given.

    `late`: by which fixes are stamped late [s], else by chance.
    """
    from pyins import sim, transform

    assumed = np.random.default_rng([seed, 9])
    lever_b = assumed.standard_normal(3)

    rng = np.random.default_rng([seed, 77])
    time, v_n, rph = motion or of_the_job(job, moving, seed)
    place = [30.4447873701, 114.4718632047, 20.899]
    trajectory, increments = sim.generate_imu(time, place, rph, v_n, sensor_type="increment")
    rate = sim.generate_imu(time, place, rph, v_n, sensor_type="rate")[1].to_numpy()[:, :3]
    truth, exact, n = trajectory.to_numpy().copy(), increments.to_numpy(), time.size
    spec, measured = load_imu(grade), []
    for k, sensor in enumerate((spec.gyro, spec.accel)):
        bias = sensor.bias * rng.standard_normal(3)
        bias = bias + job.gauss_markov(rng, n, 1 / RATE, sensor.bias_instability, sensor.correlation_time)
        turned = sensor.misalignment[:, None] * rng.standard_normal((3, 3)) * (1.0 - np.eye(3))
        turned += np.diag(1.0 + sensor.scale_factor * rng.standard_normal(3))
        white = sensor.random_walk / np.sqrt(RATE) * rng.standard_normal((n, 3))
        measured.append(exact[:, 3 * k : 3 * k + 3] @ turned.T + bias / RATE + white)
    factor = RTK if grade in ("tactical", "navigation") else 1.0
    at = np.arange(RATE, n, RATE)
    at = at[(time[at] - time[0] <= OUTAGE[0]) | (time[at] - time[0] > OUTAGE[1])]
    c_nb = transform.mat_from_rph(truth[at, 6:9])
    away = c_nb @ lever_b + factor * POSITION_SD * rng.standard_normal((at.size, 3))
    swing = np.einsum("nij,nj->ni", c_nb, np.cross(rate[at], lever_b))
    speed = truth[at, 3:6] + swing + max(factor, 0.4) * VELOCITY_SD * rng.standard_normal((at.size, 3))
    truth[:, :2], truth[:, 6:] = np.deg2rad(truth[:, :2]), np.unwrap(np.deg2rad(truth[:, 6:]), axis=0)
    fade = np.exp(-np.diff(time[at], prepend=time[at[0]]) / LASTING)[:, None]
    lasting = assumed.standard_normal((at.size, 3))
    lasting[1:] *= np.sqrt(1.0 - fade[1:] ** 2)
    for k in range(1, at.size):
        lasting[k] += fade[k] * lasting[k - 1]
    lla = lla_offset(truth[at, :3], away + factor * POSITION_SD * lasting)
    late = LATE_SD * float(assumed.standard_normal()) if late is None else late
    position_sd = np.tile(np.sqrt(2.0) * factor * POSITION_SD, (at.size, 1))
    velocity_sd = np.tile(max(factor, 0.4) * VELOCITY_SD, (at.size, 1))
    gps = GpsData(time[at] + late, lla, speed, position_sd, velocity_sd)
    imu = ImuData(time[1:], measured[0][1:], measured[1][1:], sampling="increment")
    return Recorded(imu, gps, time, truth, lever_b, late)


def navigated(drive: Recorded, **given: str) -> Run:
    return insnav.load(drive.imu, gps=drive.gps, **given).navigate(output_interval=1.0).found.run


@pytest.fixture(scope="module")
def squares(job) -> dict[str, FloatArray]:
    """Squared errors by variances of filter and smoother, (drives, rows, 9) each."""
    found: dict[str, list[FloatArray]] = {"filter": [], "smoother": []}
    for grade in GRADES:
        for moving in (False, True):
            for seed in (1, 2):
                drive = recorded(job, grade, moving, seed)
                run = navigated(drive)
                for name, each in (("filter", run.solution), ("smoother", run.smoothed.solution)):
                    found[name].append(drive.normalised(each) ** 2)
    return {name: np.array(each) for name, each in found.items()}


@pytest.mark.parametrize("of", ["filter", "smoother"])
def test_errors_are_as_large_as_stated(squares, of):
    """Twelve drives with a minute without GPS."""
    each = squares[of].reshape(-1, 3, 3).mean(axis=(0, 2))
    assert np.all(each < TOO_LARGE), each
    assert np.all(each > TOO_SMALL), each
    assert np.mean(squares[of] < 9.0) > 0.99


@pytest.mark.parametrize(("grade", "moving", "seed"), [("tactical", True, 6), ("automotive", False, 3)])
def test_turns_that_vibrate_show_the_arm_with_fixes_that_are_hardly_late(job, grade, moving, seed):
    """Early by 21 ms, the clock left as it is: lever arms down were 5 and 7.6 sd off (0.1 and 0.6 m)."""
    drive = recorded(job, grade, moving, seed)
    run = navigated(drive)
    assert abs(run.gps_delay - drive.late) < 3.0 * run.gps_delay_sd
    assert (np.abs(run.lever_b - drive.lever_b) < 3.0 * run.lever_sd).all()


@pytest.mark.parametrize("seed", [4, 7])
def test_a_road_that_shakes_a_start_in_motion_keeps_no_clock_where_it_is(job, seed):
    """Late by 18 ms: moved, innovations were larger at first, so it was not; arms were 4 and 5 sd off, positions 10."""
    drive = recorded(job, "tactical", True, seed, motorway(seed, 240.0), late=0.018)
    run = navigated(drive)
    assert abs(run.gps_delay - drive.late) < 3.0 * run.gps_delay_sd < 0.015
    assert (np.abs(run.lever_b - drive.lever_b) < 3.0 * run.lever_sd).all()
    assert (np.abs(drive.normalised(run.smoothed.solution)[:, :3]) < 3.0).all()


@pytest.mark.parametrize(("grade", "moving"), [("tactical", False), ("navigation", True)])
def test_an_arm_that_swings_makes_no_position_too_sure_with_a_known_imu(job, grade, moving):
    """Velocities of an antenna 1.7 m away scatter more than reported; 68 to 82 % of the positions were inside 3 sd."""
    drive = recorded(job, grade, moving, 9115)
    track = navigated(drive, imu=grade).smoothed.solution
    assert np.mean(np.abs(drive.normalised(track)[:, :3]) < 3.0) > 0.99
