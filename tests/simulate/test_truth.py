"""The exact truth against other equations, other integrators and another package."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
import pyins.strapdown
import pyins.util
import pymap3d
import pytest
from scipy.integrate import quad_vec, solve_ivp
from scipy.spatial.transform import Rotation

from insnav.exceptions import ConfigError
from insnav.simulate.truth import Truth, circle, imu_from_truth, straight
from tests.refusals import refused
from tests.simulate.motions import PLACE, town

OMEGA = 7.292115e-5
A, B = 6378137.0, 6356752.3142
G_EQUATOR, G_POLE = 9.7803253359, 9.8321849378


def gravity_ned(lat: float, height: float) -> np.ndarray:
    """NIMA TR8350.2 eq. 4-2 (Somigliana's own form, with both semi-axes) and eq. 4-3, written anew."""
    s2, c2 = np.sin(lat) ** 2, np.cos(lat) ** 2
    on_ellipsoid = (A * G_EQUATOR * c2 + B * G_POLE * s2) / np.sqrt(A * A * c2 + B * B * s2)
    f, m = 1 / 298.257223563, 0.00344978650684
    down = on_ellipsoid * (1 - 2 / A * (1 + f + m - 2 * f * s2) * height + 3 * (height / A) ** 2)
    return np.array([-8.08e-9 * height * np.sin(2 * lat), 0.0, down])


def ned_axes(lat: float, lon: float) -> np.ndarray:
    """Columns: North, East and Down in Earth-fixed axes."""
    s, c, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    return np.array([[-s * cl, -sl, -c * cl], [-s * sl, cl, -c * sl], [c, 0.0, -s]])


def earth_state(truth: Truth, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and attitude matrix in Earth-fixed axes."""
    at = truth.evaluate(np.array([time]))
    lat, lon, height = at.lla[0]
    axes = ned_axes(lat, lon)
    C_nb = Rotation.from_euler("ZYX", at.rph[0, ::-1]).as_matrix()
    return np.array(pymap3d.geodetic2ecef(lat, lon, height, deg=False)), axes @ at.v_n[0], axes @ C_nb


def about_pole(angle: float) -> np.ndarray:
    return Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()


def navigate_in_inertial_space(truth: Truth, begin: float, seconds: float, step: float) -> tuple[np.ndarray, ...]:
    """r'' = f + gravitation and C' = C [w x] in axes that do not turn, Earth-fixed at `begin`."""
    spin = np.array([0.0, 0.0, OMEGA])
    r, v, C = earth_state(truth, begin)

    def rates(t: float, state: np.ndarray) -> np.ndarray:
        position, velocity, C_ib = state[:3], state[3:6], state[6:].reshape(3, 3)
        at = truth.evaluate(np.array([begin + t]))
        to_inertial = about_pole(OMEGA * t)
        r_e = to_inertial.T @ position
        lat, lon, height = pymap3d.ecef2geodetic(*r_e, deg=False)
        gravitation_e = ned_axes(lat, lon) @ gravity_ned(lat, height) + np.cross(spin, np.cross(spin, r_e))
        w = at.w_ib_b[0]
        turning = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        acceleration = C_ib @ at.f_b[0] + to_inertial @ gravitation_e
        return np.concatenate([velocity, acceleration, (C_ib @ turning).ravel()])

    start = np.concatenate([r, v + np.cross(spin, r), C.ravel()])
    atol = np.concatenate([np.full(3, 1e-9), np.full(3, 1e-11), np.full(9, 1e-13)])
    end = solve_ivp(rates, (0.0, seconds), start, method="DOP853", rtol=1e-12, atol=atol, max_step=step).y[:, -1]
    back = about_pole(-OMEGA * seconds)
    r_e = back @ end[:3]
    return r_e, back @ end[3:6] - np.cross(spin, r_e), back @ end[6:].reshape(3, 3)


SMOOTH = {"band": (0.2, 0.7)}  # slow enough for the steps of a general integrator
SOUTH = np.array([np.radians(-67.0), np.radians(179.9995), 3000.0])
MOTIONS = {  # and start [s], and longest step [s]: the error estimate of the integrator misses the knots
    "car": (town(**SMOOTH), 10.0, 0.1),
    "car far south at the date line": (town(place=SOUTH, **SMOOTH), 10.0, 0.1),
    "circle": (circle(PLACE, 30.0, 0.1, 100.0, heading=2.0), 5.0, np.inf),
    "fast climb": (straight(PLACE, 250.0, 1.0, 100.0, climb=12.0, roll=0.3, pitch=0.1), 0.0, np.inf),
    "at rest": (straight(PLACE, 0.0, 1.0, 100.0), 0.0, np.inf),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_newton_in_inertial_space_gives_the_same_motion(name):
    truth, begin, step = MOTIONS[name]
    r, v, C = navigate_in_inertial_space(truth, begin, 60.0, step)
    r_true, v_true, C_true = earth_state(truth, begin + 60.0)
    assert np.linalg.norm(r - r_true) < 1e-5
    assert np.linalg.norm(v - v_true) < 1e-6
    assert np.abs(C - C_true).max() < 1e-10


def test_increments_are_the_integrals_of_rate_and_specific_force():
    truth = town()
    edges = 30.0 + np.arange(9) / 30.0  # knots every 0.04 s fall between
    imu = imu_from_truth(truth, edges)
    knots = truth.position.knots

    def sensors(t: float) -> np.ndarray:
        at = truth.evaluate(np.array([t]))
        return np.concatenate([at.w_ib_b[0], at.f_b[0]])

    for i, (a, b) in enumerate(pairwise(edges)):
        inside = knots[(knots > a) & (knots < b)]
        exact, _ = quad_vec(sensors, a, b, epsabs=1e-15, epsrel=1e-15, points=inside, limit=100)
        assert np.abs(np.concatenate([imu.gyro[i], imu.accel[i]]) - exact).max() < 1e-13


def test_long_intervals_without_knots_are_integrated_as_well():
    truth = circle(PLACE, 10.0, 3.0, 20.0)
    imu = imu_from_truth(truth, np.array([1.0, 4.0]))
    fine = imu_from_truth(truth, np.linspace(1.0, 4.0, 3001))
    np.testing.assert_allclose(imu.accel[0], fine.accel.sum(axis=0), atol=1e-12)
    np.testing.assert_allclose(imu.gyro[0], fine.gyro.sum(axis=0), atol=1e-12)


def test_longitude_stays_within_half_a_turn_across_the_date_line():
    at = straight(SOUTH, 100.0, np.pi / 2, 10.0).evaluate(np.array([0.0, 10.0]))
    assert at.lla[0, 1] > 3.14
    assert -np.pi <= at.lla[1, 1] < -3.14


def test_long_intervals_are_sums_of_short_ones():
    truth = town(start=100000.0)
    fine = imu_from_truth(truth, 100000.0 + np.arange(20001) / 200)
    coarse = imu_from_truth(truth, 100000.0 + np.arange(201) / 2)
    assert np.abs(fine.gyro.reshape(200, 100, 3).sum(axis=1) - coarse.gyro).max() < 1e-12
    assert np.abs(fine.accel.reshape(200, 100, 3).sum(axis=1) - coarse.accel).max() < 1e-11


def test_mean_is_increment_over_its_interval_and_instant_is_the_value():
    truth = town()
    time = 20.0 + np.cumsum(np.random.default_rng(1).uniform(0.004, 0.016, 50))
    increment, mean, instant = (imu_from_truth(truth, time, s) for s in ("increment", "mean", "instant"))
    np.testing.assert_allclose(mean.accel * np.diff(time)[:, None], increment.accel, rtol=1e-12)
    assert np.array_equal(mean.time, time[1:])
    assert mean.sampling == "mean"
    assert mean.stamp == "end"
    assert np.array_equal(instant.accel, truth.evaluate(time).f_b)
    assert np.array_equal(instant.time, time)


@pytest.mark.filterwarnings("ignore:The copy keyword")
def test_another_package_navigates_the_increments_to_the_same_place():
    # At sea level its gravity is ours: the models differ in how gravity falls with height.
    truth = town(place=np.array([np.radians(48.0), np.radians(11.0), 0.0]))
    edges = 10.0 + np.arange(60 * 500 + 1) / 500
    imu = imu_from_truth(truth, edges)
    frame = pd.DataFrame(
        np.column_stack([imu.gyro, imu.accel]),
        index=imu.time,
        columns=["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"],
    )
    at = truth.evaluate(imu.time[[0, -1]])
    degrees = np.array([180 / np.pi, 180 / np.pi, 1.0])
    first = pd.Series(
        np.concatenate([at.lla[0] * degrees, at.v_n[0], np.degrees(at.rph[0])]),
        index=pyins.util.TRAJECTORY_COLS,
        name=imu.time[0],
    )
    increments = pyins.strapdown.compute_increments_from_imu(frame, "increment")
    last = pyins.strapdown.Integrator(first).integrate(increments).iloc[-1]
    north, east, down = pymap3d.geodetic2ned(*last[["lat", "lon", "alt"]], *(at.lla[1] * degrees))
    assert np.hypot(north, east) < 1e-3
    assert abs(down) < 2e-3
    np.testing.assert_allclose(last[["roll", "pitch", "heading"]], np.degrees(at.rph[1]), atol=1e-5)


def test_at_rest_sensors_feel_the_turning_earth_and_gravity():
    truth = straight(PLACE, 0.0, np.radians(90.0), 10.0)
    at = truth.evaluate(np.array([0.0, 3.0]))
    g = gravity_ned(PLACE[0], PLACE[2])
    s, c = np.sin(PLACE[0]), np.cos(PLACE[0])
    # Facing East: forward is East, right is South.
    np.testing.assert_allclose(at.w_ib_b, np.tile([0.0, -OMEGA * c, -OMEGA * s], (2, 1)), atol=1e-19)
    np.testing.assert_allclose(at.f_b, np.tile([0.0, g[0], -g[2]], (2, 1)), atol=1e-9)


def test_straight_east_has_constant_speed_and_a_turn_has_its_rate_and_no_side_force():
    along = straight(PLACE, 200.0, np.pi / 2, 1000.0).evaluate(np.linspace(0.0, 1000.0, 5))
    np.testing.assert_allclose(along.v_n, np.tile([0.0, 200.0, 0.0], (5, 1)), atol=1e-9)
    turn = circle(PLACE, 20.0, -0.2, 30.0).evaluate(np.linspace(0.0, 30.0, 7))
    np.testing.assert_allclose(np.linalg.norm(turn.v_n, axis=1), 20.0, rtol=1e-4)
    np.testing.assert_allclose(turn.lla[:, 2], PLACE[2])
    np.testing.assert_allclose(
        np.arctan2(turn.v_n[:, 1], turn.v_n[:, 0]),
        np.arctan2(np.sin(turn.rph[:, 2]), np.cos(turn.rph[:, 2])),
        atol=1e-4,
    )
    assert np.abs(turn.f_b[:, 1]).max() < 0.01
    assert turn.rph[0, 0] < -0.3


def test_times_outside_the_motion_are_refused():
    truth = town(start=100.0)
    with refused(ConfigError, "sim.outside_motion"):
        truth.evaluate(np.array([99.99]))
    with refused(ConfigError, "sim.outside_motion"):
        truth.evaluate(np.array([np.nan]))
    with refused(ConfigError, "sim.outside_motion"):
        imu_from_truth(truth, np.array([100.0, 221.0]))
    with refused(ConfigError, "sim.no_increasing_times"):
        imu_from_truth(truth, np.array([101.0, 101.0]))
    with refused(ConfigError, "sim.no_turn_rate"):
        circle(PLACE, 10.0, 0.0, 10.0)
