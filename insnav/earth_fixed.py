"""Earth-fixed axes: positions and local-level attitude in them, without a singular latitude.

References
----------
Groves, "Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems", 2nd ed., 2013.
"""

from __future__ import annotations

import numpy as np

from insnav.attitude import dcm_from_quat, quat_multiply, wrap_pi
from insnav.earth import E2, A, F, radii
from insnav.types import FloatArray

_B = A * (1.0 - F)  # semi-minor axis [m]
_EP2 = E2 / (1.0 - E2)  # second eccentricity squared [-]


def geodetic(x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute distance from the axis [m], latitude [rad], height [m] (Bowring, Survey Review 28 (1985) 202-206).

    One step from Bowring's initial value, accurate to 1e-12 rad and 1e-9 m up to 100 km.
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
    out = (transverse + height) * np.cos(lat)
    return np.column_stack([out * np.cos(lon), out * np.sin(lon), ((1.0 - E2) * transverse + height) * np.sin(lat)])


def quat_earth_from_level(lla: FloatArray) -> FloatArray:
    """Compute the quaternion ``q_en`` ``(n, 4)`` of North, East, Down at positions [rad] (Groves 2013, eq. 2.150)."""
    half_lat, half_lon = 0.5 * lla[:, 0], 0.5 * lla[:, 1]
    zero = np.zeros_like(half_lat)
    about_axis = np.column_stack([np.cos(half_lon), zero, zero, np.sin(half_lon)])
    tilt = half_lat + 0.25 * np.pi
    return quat_multiply(about_axis, np.column_stack([np.cos(tilt), zero, -np.sin(tilt), zero]))


def level_from_earth(lla: FloatArray) -> FloatArray:
    """Compute rotations ``C_ne`` ``(n, 3, 3)`` from Earth-fixed axes to North, East, Down at ``(n, 3)`` positions."""
    return np.swapaxes(dcm_from_quat(quat_earth_from_level(lla)), 1, 2)


def components(rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Split ``(n, 3)`` into its columns, each contiguous."""
    x, y, z = np.ascontiguousarray(rows.T)
    return x, y, z
