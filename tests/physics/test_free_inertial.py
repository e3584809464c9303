"""Navigation without aiding against motions of an independent package and motions in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from insnav import strapdown
from insnav.attitude import dcm_from_rph
from insnav.earth import gravity_n, ned_offset
from insnav.simulate import LevelTruth, Truth, circle, imu_from_truth, reference, straight
from insnav.simulate.truth import Harmonic
from insnav.types import ImuData, Increments, Trajectory
from insnav.units import DEG
from tests.physics.conftest import later

PLACE = np.array([48.0 * DEG, 11.0 * DEG, 500.0])


def horizontal(estimate: Trajectory, true: Trajectory) -> np.ndarray:
    """Horizontal position error [m]."""
    assert np.abs(estimate.time - true.time).max() < 1e-6
    return np.hypot(*ned_offset(estimate.lla, true.lla)[:, :2].T)


# ---- the standard job: truth by python-ins


def job_errors(job, inc, span: float) -> tuple[np.ndarray, np.ndarray]:
    """Time since the start [s] and horizontal error [m], ten a second."""
    keep = inc.time < job.start + span + 1e-6
    inc = inc.rows(keep)
    ref = job.reference
    first = np.searchsorted(ref[:, 0], job.start - 1e-6)
    vertical = np.interp(inc.time, ref[:, 0], ref[:, 3]), np.interp(inc.time, ref[:, 0], ref[:, 6])
    found = strapdown.navigate(
        inc,
        ref[first, 1:4],
        ref[first, 4:7],
        ref[first, 7:10],
        vertical=vertical,
        north_gravity=False,  # that truth leaves it out
        every=20,
    )
    rows = ref[first + 1 : first + 1 + found.time.size]
    true = Trajectory(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10])
    return found.time - job.start, horizontal(found, true)


def test_standard_job_from_increments(clean_job):
    time, error = job_errors(clean_job, clean_job.increments, 3600.0)
    print(f"60 s: {1e3 * error[time < 60.05].max():.3f} mm, 1 h: {error.max():.4f} m")
    assert time[-1] > 3270.0
    assert error[time < 60.05].max() <= 0.2e-3
    assert error.max() <= 0.05


def test_standard_job_from_mean_rates(clean_job):
    imu = clean_job.imu
    near = (imu.time > clean_job.start - 1.0) & (imu.time < clean_job.start + 62.0)
    dt = 1 / 200
    rates = ImuData(imu.time[near], imu.gyro[near] / dt, imu.accel[near] / dt, "mean")
    inc = later(strapdown.increments(strapdown.intervals(rates)), clean_job.start)
    _, error = job_errors(clean_job, inc, 60.0)
    assert error.max() <= 0.2e-3


# ---- motions in closed form


def wobble(duration: float, place: np.ndarray = PLACE) -> Truth:
    """A ride on a swell: all three angles swing by degrees while the vehicle travels along a wave."""
    swing = np.array([3.0, 2.0, 4.0]) * DEG
    return LevelTruth(
        place,
        Harmonic(np.zeros(3), np.array([2e-6, 3e-6, 0.0]), np.array([0, 0, 0.2]), np.array([2e-7, 0, 0.1]), 2.0),
        Harmonic(np.array([0.02, -0.01, 0.5]), np.zeros(3), 0.7 * swing, np.roll(swing, 1), 6.0),
        duration,
    )


def free_error(truth: Truth, sampling: str, rate: float, every: float = 1.0) -> np.ndarray:
    """Horizontal error [m] of free-inertial navigation with height held to the truth, once a second."""
    n = round(truth.duration * rate)
    times = truth.start + np.arange(n + 1) / rate
    imu = imu_from_truth(truth, times, sampling)
    inc = strapdown.increments(strapdown.intervals(imu))
    if sampling == "instant":
        inc = later(inc, truth.start)  # the first value ends no interval
    true = reference(truth, times)
    found = strapdown.navigate(
        inc,
        true.lla[0],
        true.v_n[0],
        true.rph[0],
        vertical=(true.lla[1:, 2], true.v_n[1:, 2]),
        every=round(every * rate),
    )
    step = round(every * rate)
    return horizontal(found, reference(truth, times[step::step]))


MOTIONS = {
    "straight north-east": lambda s: straight(PLACE, 30.0, 0.7, s),
    "straight east, banked": lambda s: straight(PLACE, 250.0, np.pi / 2, s, roll=0.2, pitch=0.05),
    "southern hemisphere": lambda s: straight(PLACE * [-1, 1, 1], 60.0, 3.0, s, pitch=-0.03),
    "circle": lambda s: circle(PLACE, 20.0, 0.1, s),
    "circle to the left": lambda s: circle(PLACE, 50.0, -0.06, s, heading=2.0),
    "wobble": wobble,
}


@pytest.mark.parametrize("sampling", ["increment", "mean", "instant"])
@pytest.mark.parametrize("motion", MOTIONS)
def test_closed_forms_for_a_minute(motion, sampling):
    assert free_error(MOTIONS[motion](60.0), sampling, 100.0)[-1] <= 0.2e-3


@pytest.mark.parametrize(
    ("motion", "sampling"),
    [("circle", "increment"), ("circle", "instant"), ("straight east, banked", "mean")],
)
def test_closed_forms_for_an_hour(motion, sampling):
    error = free_error(MOTIONS[motion](3600.0), sampling, 50.0, 10.0)
    print(f"{motion}, {sampling}: {1e3 * error.max():.4f} mm")
    assert error.max() <= 0.05


# ---- at rest


def at_rest(lla: np.ndarray, rph: np.ndarray, duration: float, rate: float) -> Increments:
    """Increments of an IMU at rest on the turning Earth: turned Earth rate, turned gravity, both constant."""
    omega = 7.292115e-5 * np.array([np.cos(lla[0]), 0.0, -np.sin(lla[0])])
    c_bn, n = dcm_from_rph(rph).T, round(duration * rate)
    gyro, accel = c_bn @ omega / rate, -c_bn @ gravity_n(lla[0], lla[2]) / rate
    imu = ImuData(np.arange(1, n + 1) / rate, np.tile(gyro, (n, 1)), np.tile(accel, (n, 1)), "increment")
    return strapdown.increments(strapdown.intervals(imu))


@pytest.mark.parametrize(
    "place", [PLACE, [-33.9 * DEG, 151.2 * DEG, 8000.0], [78.2 * DEG, 15.6 * DEG, -100.0], [0.0, 0.0, 0.0]]
)
def test_a_thing_at_rest_stays_where_it_is(place):
    place, rph = np.asarray(place), np.array([0.1, -0.3, 2.2])
    inc = at_rest(place, rph, 4 * 3600.0, 50.0)
    n = inc.time.size
    vertical = np.full(n, place[2]), np.zeros(n)
    found = strapdown.navigate(inc, place, np.zeros(3), rph, vertical=vertical, every=500)
    moved = np.hypot(*ned_offset(found.lla, place)[:, :2].T)
    assert moved.max() <= 0.1e-3
    assert np.abs(found.rph - rph).max() <= 1e-10


@pytest.mark.parametrize(("first", "v_down"), [(1.0, 0.0), (0.0, 0.01)])
def test_a_free_height_error_grows_as_cosh(first, v_down):
    rph = np.array([0.0, 0.0, 1.0])
    inc = at_rest(PLACE, rph, 1200.0, 50.0)
    start = PLACE + np.array([0.0, 0.0, first]), np.array([0.0, 0.0, v_down])
    found = strapdown.navigate(inc, *start, rph, every=50)
    # height error e'' = 2 g / R e (Groves 2013, eq. 5.103 f.)
    k = np.sqrt(2 * 9.81 / 6.371e6)
    for time in (600, 1200):
        wanted = first * np.cosh(k * time) - v_down / k * np.sinh(k * time)
        assert found.lla[time - 1, 2] - PLACE[2] == pytest.approx(wanted, rel=0.01)


def test_a_tilt_oscillates_with_the_schuler_period():
    # East channel at the equator: there the Earth's rotation turns the level frame about North only, and a tilt about
    # North and an east velocity make an oscillator of their own, period 2 pi sqrt((R_N + h) / g)
    place, tilt, rate = np.array([0.0, 0.0, 500.0]), 1e-4, 5.0
    inc = at_rest(place, np.zeros(3), 2.1 * 5064.0, rate)
    vertical = np.full(inc.time.size, place[2]), np.zeros(inc.time.size)
    found = strapdown.navigate(inc, place, np.zeros(3), np.array([tilt, 0.0, 0.0]), vertical=vertical)
    v = found.v_n[:, 1]
    turns = np.flatnonzero(np.diff(np.signbit(v[10:]))) + 10
    crossing = found.time[turns] - v[turns] / (v[turns + 1] - v[turns]) / rate
    g = 9.7803253359 * (1 - 2 * 500.0 / 6378137.0)
    period = 2 * np.pi * np.sqrt((6378137.0 + 500.0) / g)
    assert crossing.size == 4
    np.testing.assert_allclose(crossing, period * np.array([0.5, 1.0, 1.5, 2.0]), rtol=1e-3)
    assert np.abs(v).max() == pytest.approx(tilt * np.sqrt(g * 6378637.0), rel=1e-3)
    assert v[100] > 0.0  # right side down by mistake: gravity is taken for an acceleration to the right


def test_errors_do_not_change_at_the_date_line():
    errors = []
    for lon in (0.0, np.pi - 1e-6):  # 4 m before the line
        truth = circle(np.array([0.8, lon, 100.0]), 20.0, 0.1, 120.0)
        times = np.arange(120 * 50 + 1) / 50
        inc = strapdown.increments(strapdown.intervals(imu_from_truth(truth, times)))
        true = reference(truth, times)
        found = strapdown.navigate(inc, true.lla[0], true.v_n[0] + [0.1, 0.2, 0.0], true.rph[0] + [1e-3, 0, 0])
        assert (np.abs(found.lla[:, 1]) <= np.pi).all()
        errors.append(ned_offset(found.lla, true.lla[1:]))
    assert (np.abs(np.diff(found.lla[:, 1])) > 6.0).any()  # it was crossed
    assert np.abs(errors[0]).max() > 20.0
    assert np.abs(errors[1] - errors[0]).max() <= 1e-6


def test_north_gravity_can_be_left_out_and_is_in_by_default():
    high = circle(np.array([45.0 * DEG, 0.0, 20e3]), 20.0, 0.1, 60.0)
    times = np.arange(601) / 10
    inc = strapdown.increments(strapdown.intervals(imu_from_truth(high, times)))
    true = reference(high, times)
    start = true.lla[0], true.v_n[0], true.rph[0]
    with_it, without = (strapdown.navigate(inc, *start, north_gravity=choice) for choice in (True, False))
    north = ned_offset(without.lla, with_it.lla)[-1, 0]
    assert north == pytest.approx(0.5 * 8.08e-9 * 20e3 * 60.0**2, rel=0.01)  # 16 ug for a minute
