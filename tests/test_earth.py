"""The Earth against published figures, other packages, and the potential it is derived from."""

from __future__ import annotations

import numpy as np
import pymap3d
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from insnav import earth
from insnav.attitude import dcm_from_quat
from insnav.kernels.errorstate import move_along, move_by_motion

GEOD = pyproj.Geod(ellps="WGS84")
LATITUDES = np.radians([-89.0, -60.0, -30.0, 0.0, 1e-6, 20.0, 45.0, 71.0, 89.9])


@pytest.mark.parametrize(("lat_deg", "published"), [(0.0, 9.7803253359), (90.0, 9.8321849379), (-90.0, 9.8321849379)])
def test_gravity_on_the_ellipsoid_is_the_published_one(lat_deg, published):
    # NIMA TR8350.2, table 3.4
    g = earth.gravity_n(np.radians(lat_deg), 0.0)
    assert g[2] == pytest.approx(published, abs=2e-10)
    assert g[0] == pytest.approx(0.0, abs=1e-15)
    assert g[1] == 0.0


def potential(rho: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Gravity potential of the WGS-84 ellipsoid [m^2/s^2] at distance `rho` from the axis, `z` from the equator [m].

    Heiskanen and Moritz, Physical Geodesy, 1967, eq. 1-103 to 1-104 and 2-62, with the series of eq. 2-57 f. for q.
    """
    a, b, gm, omega = 6378137.0, 6356752.3142451793, 3.986004418e14, 7.292115e-5
    e2 = a * a - b * b  # linear eccentricity squared

    def q(u):
        x = np.sqrt(e2) / u
        return sum(-((-1) ** k) * 2 * k / ((2 * k + 1) * (2 * k + 3)) * x ** (2 * k + 1) for k in range(1, 9))

    r2 = rho * rho + z * z - e2
    u2 = 0.5 * (r2 + np.sqrt(r2 * r2 + 4 * e2 * z * z))
    u = np.sqrt(u2)
    sin2 = z * z / u2
    own = gm / np.sqrt(e2) * np.arctan(np.sqrt(e2) / u) + 0.5 * omega**2 * a**2 * q(u) / q(b) * (sin2 - 1 / 3)
    return own + 0.5 * omega**2 * rho * rho


def gradient_of_potential(lat, height, d):
    """North and down components, by differences over steps of `d` [m]."""
    x, _, z = pymap3d.geodetic2ecef(lat, 0.0, height, deg=False)
    s, c = np.sin(lat), np.cos(lat)
    north = (potential(x - d * s, z + d * c) - potential(x + d * s, z - d * c)) / (2 * d)
    return north, (potential(x - d * c, z - d * s) - potential(x + d * c, z + d * s)) / (2 * d)


@pytest.mark.parametrize("height", [0.0, 1e3, 1e4, 2e4])
def test_gravity_is_the_gradient_of_the_normal_potential(height):
    lat = np.radians(np.linspace(-85.0, 85.0, 35))
    north, down = gradient_of_potential(lat, height, 200.0)
    g = earth.gravity_n(lat, height)
    assert np.max(np.abs(g[:, 2] - down)) < 1e-6 * 9.8
    assert np.max(np.abs(g[:, 0] - north)) < 1e-6 * 9.8
    if height == 2e4:  # what leaving the north component out would cost
        assert np.max(np.abs(north)) > 10e-6 * 9.8


@pytest.mark.parametrize("lat", LATITUDES)
def test_radii_are_lengths_along_the_ellipsoid(lat):
    meridian, transverse = earth.radii(lat)
    d = 1e-5
    _, _, along = GEOD.inv(0.0, np.degrees(lat - d), 0.0, np.degrees(lat + d))
    assert meridian == pytest.approx(along / (2 * d), rel=1e-8)
    x, y, _ = pymap3d.geodetic2ecef(lat, 0.3, 0.0, deg=False)
    assert transverse * np.cos(lat) == pytest.approx(np.hypot(x, y), rel=1e-12)


def test_earth_rate_is_the_axis_of_the_earth_in_local_axes():
    lat = 0.7
    axis = np.array(pymap3d.ecef2enuv(0.0, 0.0, earth.OMEGA_EARTH, lat, 1.1, deg=False))
    assert earth.earth_rate_n(lat) == pytest.approx(axis[[1, 0, 2]] * [1, 1, -1], abs=1e-19)
    assert pytest.approx(2 * np.pi / 86164.0989, rel=3e-8) == earth.OMEGA_EARTH  # a stellar day


def local_axes(lat: float, lon: float) -> np.ndarray:
    """Rows North, East, Down in Earth-fixed axes."""
    s, c, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    return np.array([[-s * cl, -s * sl, c], [-sl, cl, 0.0], [-c * cl, -c * sl, -s]])


@pytest.mark.parametrize("lat", LATITUDES)
def test_transport_rate_is_the_rotation_of_the_local_axes(lat):
    lon, height, v = 2.0, 3000.0, np.array([120.0, -70.0, 15.0])
    # follow the velocity for a moment in Earth-fixed coordinates, and see how the local axes have turned
    x = np.array(pymap3d.geodetic2ecef(lat, lon, height, deg=False))
    dt = 0.05
    ends = [pymap3d.ecef2geodetic(*(x + sign * dt * local_axes(lat, lon).T @ v), deg=False) for sign in (-1, 1)]
    before, after = (local_axes(float(e[0]), float(e[1])) for e in ends)
    # C_ne' = -[w_en_n x] C_ne
    turn = -(after - before) / (2 * dt) @ local_axes(lat, lon).T
    w = earth.transport_rate_n(lat, height, v)
    scale = np.linalg.norm(w)
    assert np.array([turn[2, 1], turn[0, 2], turn[1, 0]]) == pytest.approx(w, abs=3e-6 * scale)


place = st.tuples(st.floats(-1.5, 1.5), st.floats(-3.1415, 3.1415), st.floats(-400.0, 20000.0))
small = st.tuples(*[st.floats(-100.0, 100.0)] * 3)


@given(place, small)
def test_offset_and_difference_are_inverse(origin, ned):
    there = earth.lla_offset(origin, ned)
    assert earth.ned_offset(there, origin) == pytest.approx(ned, abs=1e-7)
    assert -np.pi <= there[1] < np.pi


@given(st.floats(-1.2, 1.2), st.floats(-3.1, 3.1), small)
def test_offset_is_that_of_local_cartesian_coordinates(lat, lon, ned):
    there = earth.lla_offset([lat, lon, 100.0], ned)
    n, e, d = pymap3d.geodetic2ned(*there, lat, lon, 100.0, deg=False)
    assert [float(n), float(e), float(d)] == pytest.approx(ned, abs=1e-2)  # 100 m on a curved Earth


def test_difference_takes_the_short_way_across_the_date_line():
    east = earth.ned_offset([0.3, -np.pi + 1e-7, 0.0], [0.3, np.pi - 1e-7, 0.0])[1]
    assert east == pytest.approx(earth.ned_offset([0.3, 2e-7, 0.0], [0.3, 0.0, 0.0])[1], abs=1e-7)


def from_earth(lat: float, lon: float) -> np.ndarray:
    """Matrix from the axes of the Earth to north, east, down."""
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    down = -np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    return np.array([np.cross(east, down), east, down])


@pytest.mark.parametrize("height", [0.0, 20_000.0])
def test_a_state_moved_by_its_motion_is_where_pymap3d_and_the_turn_of_the_earth_say(height):
    """For a second without rotation against the stars, with acceleration and without; and along its velocity alone."""
    start, force = np.array([0.8, 0.2, height, 200.0, -150.0, 10.0, 1.0, 0.0, 0.0, 0.0]), np.array([0.5, 1.0, -0.2])
    moved, straight = np.tile(start, (3, 1)), start[None].copy()
    move_by_motion(moved, np.array([1, 2]), np.array([[0.0, 0.0, 0.0, *force], np.zeros(6)]), np.ones(2))
    move_along(straight, np.ones(1))
    np.testing.assert_array_equal(moved[0], start)
    for x, way in ((moved[1], start[3:6] + 0.5 * force), (straight[0], start[3:6])):
        gone = pymap3d.geodetic2ned(x[0], x[1], x[2], *start[:3], deg=False)
        np.testing.assert_allclose(gone, way, atol=0.02)  # half the square of the way over the radius: 5 mm
    np.testing.assert_allclose(moved[1, 3:6], start[3:6] + force, rtol=1e-12)
    turned = 7.292115e-5  # of the Earth in a second [rad]
    spin = np.array([[np.cos(turned), np.sin(turned), 0.0], [-np.sin(turned), np.cos(turned), 0.0], [0.0, 0.0, 1.0]])
    body = from_earth(*moved[2, :2]) @ spin @ from_earth(*start[:2]).T
    np.testing.assert_allclose(dcm_from_quat(moved[2, 6:]), body, atol=2e-8)
