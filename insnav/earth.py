"""Earth: WGS-84 radii, rotation rate, transport rate, normal gravity, and conversions to and from Earth-fixed axes.

References
----------
NIMA TR8350.2, "Department of Defense World Geodetic System 1984", 3rd ed., amendment 1, 2000.
Groves, "Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems", 2nd ed., 2013.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from insnav.attitude import dcm_from_quat, quat_multiply, wrap_pi
from insnav.kernels import earth as _kernel
from insnav.kernels.earth import E2 as E2
from insnav.kernels.earth import A as A
from insnav.kernels.earth import F as F
from insnav.types import BoolArray, FloatArray

OMEGA_EARTH = _kernel.OMEGA
POLE_DISTANCE = 1000.0  # closer to a pole [m], heading and longitude are of no use


def _elementwise(compiled: Any) -> Any:
    """Return the Python function of a compiled kernel, which also accepts arrays; unchanged without compilation."""
    return getattr(compiled, "py_func", compiled)


_radii = _elementwise(_kernel.radii)
_gravity_down = _elementwise(_kernel.gravity_down)
_gravity_north = _elementwise(_kernel.gravity_north)


def radii(lat: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Compute radii of curvature in the meridian and in the prime vertical [m] (Groves 2013, section 2.4.2).

    `lat` (...): latitude [rad].
    """
    meridian, transverse = _radii(np.sin(np.asarray(lat, dtype=float)))
    return meridian, transverse


def metres_per_unit(lla: ArrayLike) -> FloatArray:
    """Compute metres per radian of latitude and longitude, and per metre of height, at `lla`; both are (..., 3)."""
    lat, _, height = np.moveaxis(np.asarray(lla, dtype=float), -1, 0)
    meridian, transverse = radii(lat)
    return np.stack([meridian + height, (transverse + height) * np.cos(lat), np.ones_like(lat)], axis=-1)


def gravity_n(lat: ArrayLike, height: ArrayLike) -> FloatArray:
    """Compute WGS-84 normal gravity (..., 3), NED [m/s^2] (NIMA TR8350.2, eq. 4-1, 4-3; Groves 2013, eq. 2.140).

    `lat` (...): latitude [rad]. `height` (...): above the ellipsoid [m]; accurate to 1 ug up to 20 km.
    """
    lat, height = np.broadcast_arrays(np.asarray(lat, dtype=float), np.asarray(height, dtype=float))
    s, c = np.sin(lat), np.cos(lat)
    return np.stack([_gravity_north(s, c, height), np.zeros_like(lat), _gravity_down(s, height)], axis=-1)


def earth_rate_n(lat: ArrayLike) -> FloatArray:
    """Compute the Earth's rotation rate ``w_ie_n`` (..., 3) [rad/s] at latitudes (...) [rad] (Groves, eq. 2.123)."""
    lat = np.asarray(lat, dtype=float)
    return OMEGA_EARTH * np.stack([np.cos(lat), np.zeros_like(lat), -np.sin(lat)], axis=-1)


def transport_rate_n(lat: ArrayLike, height: ArrayLike, v_n: ArrayLike) -> FloatArray:
    """Compute the rotation rate of the local-level frame against the Earth (Groves 2013, eq. 5.44).

    `lat` (...): latitude [rad]; `height` (...) [m]. `v_n` (..., 3): velocity North, East, Down [m/s].
    Returns: (..., 3): ``w_en_n`` [rad/s].
    """
    v_n = np.asarray(v_n, dtype=float)
    meridian, transverse = radii(lat)
    height = np.asarray(height, dtype=float)
    north, east = v_n[..., 0] / (meridian + height), v_n[..., 1] / (transverse + height)
    return np.stack([east, -north, -east * np.tan(np.asarray(lat, dtype=float))], axis=-1)


def near_pole(lat: ArrayLike) -> BoolArray:
    """Return whether latitudes (...) [rad] are within a kilometre of a pole, where heading is undefined."""
    return np.asarray(np.cos(lat) < POLE_DISTANCE * (1.0 - E2) ** 0.5 / A)


def ned_offset(lla: ArrayLike, origin: ArrayLike) -> FloatArray:
    """Compute a small difference of two positions in metres.

    `lla`, `origin` (..., 3): latitude [rad], longitude [rad], height [m].
    Returns: (..., 3): North, East, Down from `origin` to `lla` [m], with the radii at `origin`. First-order accurate,
    for errors and lever arms, not for distances of kilometres.
    """
    lla, origin = np.asarray(lla, dtype=float), np.asarray(origin, dtype=float)
    meridian, transverse = radii(origin[..., 0])
    d = lla - origin
    east = (d[..., 1] + np.pi) % (2 * np.pi) - np.pi  # in [-pi, pi), also across the date line
    return np.stack(
        [
            d[..., 0] * (meridian + origin[..., 2]),
            east * (transverse + origin[..., 2]) * np.cos(origin[..., 0]),
            -d[..., 2],
        ],
        axis=-1,
    )


def lla_offset(origin: ArrayLike, ned: ArrayLike) -> FloatArray:
    """Compute the position at a small offset from `origin`; the inverse of `ned_offset`.

    `origin` (..., 3): latitude [rad], longitude [rad], height [m]. `ned` (..., 3): offset North, East, Down [m].
    Returns: (..., 3): latitude [rad], longitude [rad] in [-pi, pi), height [m].
    """
    origin, ned = np.asarray(origin, dtype=float), np.asarray(ned, dtype=float)
    meridian, transverse = radii(origin[..., 0])
    lon = origin[..., 1] + ned[..., 1] / ((transverse + origin[..., 2]) * np.cos(origin[..., 0]))
    return np.stack(
        [
            origin[..., 0] + ned[..., 0] / (meridian + origin[..., 2]),
            (lon + np.pi) % (2 * np.pi) - np.pi,
            origin[..., 2] - ned[..., 2],
        ],
        axis=-1,
    )


_B = A * (1.0 - F)  # semi-minor axis [m]
_EP2 = E2 / (1.0 - E2)  # second eccentricity squared [-]


def geodetic(x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Convert Earth-fixed coordinates [m] to distance from the rotation axis [m], latitude [rad] and height [m].

    One step of Bowring's iteration (Survey Review 28 (1985) 202-206), accurate to 1e-12 rad and 1e-9 m up to 100 km.
    """
    p = np.hypot(x, y)
    r = np.hypot(p, z)
    t, u = _B * z * (1.0 + _EP2 * _B / r), A * p  # tangent of the parametric latitude is t / u
    s, c = t / np.hypot(t, u), u / np.hypot(t, u)
    t, u = z + _EP2 * _B * s**3, p - E2 * A * c**3
    w = np.hypot(t, u)
    s, c = t / w, u / w
    return p, np.arctan2(t, u), p * c + z * s - A * np.sqrt(1.0 - E2 * s * s)


def lla_from_earth(r_e: FloatArray) -> FloatArray:
    """Convert Earth-fixed positions ``(n, 3)`` [m] to latitude, longitude in [-pi, pi) [rad], height [m]."""
    x, y, z = components(r_e)
    _, lat, height = geodetic(x, y, z)
    return np.column_stack([lat, wrap_pi(np.arctan2(y, x)), height])


def earth_from_lla(lla: FloatArray) -> FloatArray:
    """Convert latitude, longitude [rad], height [m] to Earth-fixed positions ``(n, 3)`` [m] (Groves, eq. 2.112)."""
    lat, lon, height = components(lla)
    _, transverse = radii(lat)
    from_axis = (transverse + height) * np.cos(lat)
    return np.column_stack(
        [from_axis * np.cos(lon), from_axis * np.sin(lon), ((1.0 - E2) * transverse + height) * np.sin(lat)]
    )


def quat_earth_from_level(lla: FloatArray) -> FloatArray:
    """Compute ``q_en`` (n, 4), from North, East, Down at positions [rad] to Earth-fixed axes (Groves, eq. 2.150)."""
    half_lat, half_lon = 0.5 * lla[:, 0], 0.5 * lla[:, 1]
    zero = np.zeros_like(half_lat)
    about_axis = np.column_stack([np.cos(half_lon), zero, zero, np.sin(half_lon)])
    half_tilt = half_lat + 0.25 * np.pi
    return quat_multiply(about_axis, np.column_stack([np.cos(half_tilt), zero, -np.sin(half_tilt), zero]))


def level_from_earth(lla: FloatArray) -> FloatArray:
    """Compute rotations ``C_ne`` ``(n, 3, 3)`` from Earth-fixed axes to North, East, Down at ``(n, 3)`` positions."""
    return np.swapaxes(dcm_from_quat(quat_earth_from_level(lla)), 1, 2)


def components(rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Split ``(n, 3)`` into its columns, each contiguous."""
    x, y, z = np.ascontiguousarray(rows.T)
    return x, y, z
