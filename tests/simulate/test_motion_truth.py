"""Truth of motion profiles: by another integrator, by our navigation, by another package, and over the pole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pyins.strapdown
import pyins.util
import pytest

from insnav import strapdown
from insnav.earth import ned_offset
from insnav.earth_fixed import earth_from_lla
from insnav.input import read_imu
from insnav.output.data_files import write_data
from insnav.simulate import Truth, imu_from_truth, reference
from insnav.simulate.motion import library, load_profile
from insnav.simulate.recording import perfect_imu
from insnav.simulate.truth import EarthTruth, LevelTruth
from insnav.types import ImuData, Trajectory
from tests.simulate.profiles import profile
from tests.simulate.test_truth import earth_state, navigate_in_inertial_space

START = 'heading = "40 deg"\nspeed = "15 m/s"'


def driven(tmp_path) -> Truth:
    lines = ('turn: angle = "70 deg", rate = "10 deg/s"', 'climb: height = "4 m"', 'brake: to = "5 m/s"')
    truth = profile(tmp_path, *lines, start=START).truth(0)
    assert isinstance(truth, LevelTruth)
    return truth


def tumbled(tmp_path) -> Truth:
    lines = (
        'spin: axis = "y", angle = "100 deg", rate = "20 deg/s"',
        'spin: axis = [1, 2, 3], turns = 1.0, rate = "40 deg/s"',
    )
    truth = profile(tmp_path, *lines, vehicle="slide", start='heading = "40 deg"').truth(0)
    assert isinstance(truth, EarthTruth)
    return truth


def flown(tmp_path) -> Truth:
    lines = ('cruise: duration = "4 s"', 'turn: angle = "30 deg", rate = "3 deg/s"')
    start = 'heading = "1 deg"\nspeed = "240 m/s"'
    truth = profile(tmp_path, *lines, vehicle="aircraft", start=start, lat="89.99 deg").truth(0)
    assert truth.evaluate(truth.start + np.arange(0.0, 9.0, 0.1)).lla[:, 0].max() > np.radians(89.999)  # over the pole
    return truth


@pytest.mark.parametrize("make", [driven, tumbled, flown])
def test_newton_in_inertial_space_gives_the_same_motion(tmp_path, make):
    truth = make(tmp_path)
    seconds = np.floor(truth.duration)
    r, v, C = navigate_in_inertial_space(truth, truth.start, seconds, 0.25)
    r_true, v_true, C_true = earth_state(truth, truth.start + seconds)
    print(np.linalg.norm(r - r_true), np.linalg.norm(v - v_true), np.abs(C - C_true).max())
    assert np.linalg.norm(r - r_true) < 1e-5
    assert np.linalg.norm(v - v_true) < 1e-6
    assert np.abs(C - C_true).max() < 1e-9


# ---- an hour of driving, navigated


def hour(tmp_path_factory, suspension: float) -> Truth:
    """The standard hour with this much vibration, from where it moves."""
    (source,) = (path for path in library() if path.stem == "standard_hour")
    path = tmp_path_factory.mktemp("hour") / "hour.toml"
    path.write_text(f"{source.read_text()}\n[vibration]\nsuspension = {suspension}\n")
    return load_profile(path).truth(1)


@pytest.fixture(scope="module")
def smooth(tmp_path_factory) -> Truth:
    return hour(tmp_path_factory, 0.0)


@pytest.fixture(scope="module")
def summed(smooth) -> ImuData:
    """An hour of increments."""
    return imu_from_truth(smooth, 125.0 + np.arange(3600 * 100 + 1) / 100)


def horizontal(truth: Truth, imu: ImuData) -> tuple[np.ndarray, np.ndarray]:
    """Time since the start [s] and horizontal error [m] of our navigation, height held."""
    inc = strapdown.increments(strapdown.intervals(imu))
    begin = inc.time[0] - inc.dt[0]
    first, true = reference(truth, np.array([begin])), reference(truth, inc.time)
    held = true.lla[:, 2], true.v_n[:, 2]
    found = strapdown.navigate(inc, first.lla[0], first.v_n[0], first.rph[0], vertical=held, every=10)
    true = reference(truth, found.time)
    return found.time - begin, np.hypot(*ned_offset(found.lla, true.lla)[:, :2].T)


@pytest.mark.parametrize("sampling", ["increment", "mean", "instant"])
def test_our_navigation_returns_the_truth_after_a_minute_and_an_hour(smooth, summed, sampling):
    edges = 125.0 + np.arange(3600 * 100 + 1) / 100
    assert np.linalg.norm(smooth.evaluate(edges[:1]).v_n) > 1.0
    imu = imu_from_truth(smooth, edges, "instant") if sampling == "instant" else summed
    if sampling == "mean":
        dt = np.diff(edges)[:, None]
        imu = replace(imu, gyro=imu.gyro / dt, accel=imu.accel / dt, sampling="mean")
    time, error = horizontal(smooth, imu)
    print(f"{sampling}: 60 s {1e3 * error[time <= 60.0].max():.4f} mm, 1 h {1e3 * error.max():.4f} mm")
    assert time[-1] > 3599.0
    assert error[time <= 60.0].max() <= 0.2e-3
    assert error.max() <= 1e-3  # 0.02 m were asked for


def test_a_shaken_car_is_navigated_as_well(tmp_path_factory):
    truth = hour(tmp_path_factory, 1.0)
    minute = imu_from_truth(truth, 125.0 + np.arange(60 * 100 + 1) / 100)
    assert horizontal(truth, minute)[1].max() <= 0.2e-3
    _, error = horizontal(truth, imu_from_truth(truth, 125.0 + np.arange(3590 * 200 + 1) / 200))
    print(f"200 Hz, vibration up to 6 Hz: {error.max():.4f} m")
    assert error.max() <= 0.02


# ---- another package on the same files


def by_pyins(imu: ImuData, first: Trajectory) -> pd.Series:
    """Where pyins ends."""
    columns = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
    frame = pd.DataFrame(np.column_stack([imu.gyro, imu.accel]), index=imu.time, columns=columns)
    state = [*np.degrees(first.lla[0, :2]), first.lla[0, 2], *first.v_n[0], *np.degrees(first.rph[0])]
    begin = pd.Series(state, index=pyins.util.TRAJECTORY_COLS, name=imu.time[0])
    increments = pyins.strapdown.compute_increments_from_imu(frame, "increment")
    return pyins.strapdown.Integrator(begin).integrate(increments).iloc[-1]


@pytest.mark.filterwarnings("ignore:The copy keyword")
def test_another_package_agrees_on_the_same_file_under_its_own_gravity(tmp_path, smooth):
    """1 km up, where the two kinds of gravity are 0.5 ug apart downwards and 0.7 ug northwards."""
    off = {}
    for gravity in ("linear", "full"):
        truth = replace(smooth, gravity=gravity, origin=smooth.origin + np.array([0.0, 0.0, 900.0]))
        write_data(tmp_path / "imu.csv", imu_from_truth(truth, 125.0 + np.arange(600 * 100 + 1) / 100))
        imu = read_imu(tmp_path / "imu.csv").data
        end, true = by_pyins(imu, reference(truth, imu.time[:1])), reference(truth, imu.time[-1:])
        found = np.array([[*np.radians(end[["lat", "lon"]]), end["alt"]]])
        off[gravity] = np.abs(ned_offset(found, true.lla)[0])
        print(gravity, off[gravity].round(5), "m after 600 s")
    np.testing.assert_array_less(off["linear"], 0.01)  # to which its trapezoids are good at 100 Hz
    assert off["full"][0] > 1.0
    assert off["full"][2] > 1.0


# ---- over the pole


def test_the_pole_is_a_place_like_any_other():
    truth = load_profile("over_the_pole").truth(0)
    time = truth.start + np.arange(0.0, truth.duration, 0.5)
    at = truth.evaluate(time)
    assert at.lla[:, 0].max() <= np.pi / 2
    assert at.lla[:, 0].max() > np.radians(89.99)
    lon = np.degrees(at.lla[:, 1])
    assert abs(abs(lon[-1] - lon[0]) - 180.0) < 10.0
    # what sensors feel knows nothing of the pole: a level flight, all the way
    flight = perfect_imu(truth, 20.0)
    straight = (flight.time < 190.0) | ((flight.time > 260.0) & (flight.time < 595.0))
    np.testing.assert_allclose(flight.accel[straight, 2], flight.accel[0, 2], atol=2e-4)
    # the way is as long as the speed says, measured through the air and not along meridians
    r_e = earth_from_lla(at.lla)
    np.testing.assert_allclose(np.linalg.norm(np.diff(r_e, axis=0), axis=1), 120.0, rtol=1e-6)
    # and our navigation closes, without height held: ten minutes, 145 km
    imu = imu_from_truth(truth, truth.start + np.arange(600 * 50 + 1) / 50)
    first = reference(truth, np.array([truth.start]))
    inc = strapdown.increments(strapdown.intervals(imu))
    held = reference(truth, inc.time)
    found = strapdown.navigate(inc, first.lla[0], first.v_n[0], first.rph[0], vertical=(held.lla[:, 2], held.v_n[:, 2]))
    off = np.linalg.norm(earth_from_lla(found.lla[-1:]) - earth_from_lla(held.lla[-1:]))
    print(f"over the pole: {off:.5f} m")
    assert off < 0.01
