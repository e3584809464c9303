"""Nothing configured, data of an independent simulator (python-ins): errors are as large as stated, or smaller."""

from __future__ import annotations

import importlib.util
from types import ModuleType

import numpy as np
import pytest

import insnav
from insnav.attitude import wrap_pi
from insnav.earth import lla_offset, ned_offset
from insnav.imu import load_imu
from insnav.types import FloatArray, GpsData, ImuData
from tests.shared import STANDARD_JOB

RATE, LENGTH, OUTAGE = 100, 420.0, (250.0, 310.0)  # [Hz], [s], [s]
LEVER_B = np.array([0.6, -0.3, -0.9])
POSITION_SD, VELOCITY_SD = np.array([1.0, 1.0, 2.0]), np.array([0.05, 0.05, 0.1])
RTK = 0.02  # of that for the better IMUs
GRADES = "consumer", "tactical", "navigation"
TOO_LARGE = 1.25  # mean squared error by variance
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


def recorded(job: ModuleType, grade: str, moving: bool, seed: int) -> tuple[ImuData, GpsData, FloatArray, FloatArray]:
    """Samples, fixes, times and truth (n, 9): latitude, longitude [rad], height, velocity, attitude [rad]."""
    from pyins import sim, transform

    rng = np.random.default_rng([seed, 77])
    time, v_n, rph, _ = job.motion(np.random.default_rng(seed), 340.0 + LENGTH + 60.0, RATE)
    first = int((340.0 if moving else 240.0) * RATE)
    time, v_n, rph = (each[first : first + int(LENGTH * RATE) + 1] for each in (time, v_n, rph))
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
    away = c_nb @ LEVER_B + factor * POSITION_SD * rng.standard_normal((at.size, 3))
    swing = np.einsum("nij,nj->ni", c_nb, np.cross(rate[at], LEVER_B))
    speed = truth[at, 3:6] + swing + max(factor, 0.4) * VELOCITY_SD * rng.standard_normal((at.size, 3))
    truth[:, :2], truth[:, 6:] = np.deg2rad(truth[:, :2]), np.unwrap(np.deg2rad(truth[:, 6:]), axis=0)
    lla = lla_offset(truth[at, :3], away)
    position_sd = np.tile(factor * POSITION_SD, (at.size, 1))
    gps = GpsData(time[at], lla, speed, position_sd, np.tile(max(factor, 0.4) * VELOCITY_SD, (at.size, 1)))
    return ImuData(time[1:], measured[0][1:], measured[1][1:], sampling="increment"), gps, time, truth


@pytest.fixture(scope="module")
def squares(job) -> dict[str, FloatArray]:
    """Squared errors by variances of filter and smoother, (drives, rows, 9) each."""
    found: dict[str, list[FloatArray]] = {"filter": [], "smoother": []}
    for grade in GRADES:
        for moving in (False, True):
            for seed in (1, 2):
                imu, gps, time, truth = recorded(job, grade, moving, seed)
                run = insnav.load(imu, gps=gps).navigate(output_interval=1.0).found.run
                for name, each in (("filter", run.solution), ("smoother", run.smoothed.solution)):
                    rows = np.flatnonzero((each.time > time[0] + SETTLED) & (each.time < time[-1] - 1.0))[:300]
                    true = np.column_stack([np.interp(each.time[rows], time, column) for column in truth.T])
                    error = np.hstack(
                        [
                            ned_offset(each.lla[rows], true[:, :3]),
                            each.v_n[rows] - true[:, 3:6],
                            wrap_pi(each.rph[rows] - true[:, 6:]),
                        ]
                    )
                    found[name].append((error / each.sd[rows]) ** 2)
    return {name: np.array(each) for name, each in found.items()}


@pytest.mark.parametrize("of", ["filter", "smoother"])
def test_errors_are_no_larger_than_stated(squares, of):
    """Twelve drives with a minute without GPS. Smaller they may be: a lever arm and lasting errors nobody excludes."""
    each = squares[of].reshape(-1, 3, 3).mean(axis=(0, 2))
    assert np.all(each < TOO_LARGE), each
    assert np.all(each > 0.1), each  # and not by far
    assert np.mean(squares[of] < 9.0) > 0.98
    for better in np.split(squares[of], len(GRADES))[1:]:  # where no rest shows it, the drive shows what IMU it is
        each = better.reshape(-1, 3, 3).mean(axis=(0, 2))
        assert np.all(each < TOO_LARGE), each
        assert each[2] > 0.5, each
