"""Exact normal gravity of the WGS-84 ellipsoid without series, compared with this package's gravity.

References
----------
Heiskanen and Moritz, Physical Geodesy, 1967: potential of the level ellipsoid, sections 2-7 and 2-8; ellipsoidal
coordinates, sections 1-19 and 1-20.
NIMA TR8350.2, 3rd ed., amendment 1, 2000: constants, tables 3.1 and 3.4.
"""

from __future__ import annotations

import numpy as np
import pymap3d
from numpy.typing import ArrayLike

from insnav.certificate.integrators import Check
from insnav.earth import gravity_n
from insnav.types import FloatArray
from insnav.units import DEG, UG

# the four defining constants, independent of the package's own
_A, _F, _GM, _OMEGA = 6378137.0, 1.0 / 298.257223563, 3.986004418e14, 7.292115e-5
_B = _A * (1.0 - _F)
_E = np.sqrt(_A * _A - _B * _B)  # linear eccentricity [m]
PUBLISHED = {0.0: 9.7803253359, 90.0: 9.8321849378}  # latitude [deg] -> normal gravity [m/s^2], TR8350.2 table 3.4
HEIGHTS = (1e3, 5e3, 10e3, 20e3)  # [m]


def _q(u: FloatArray | float) -> FloatArray:
    """Compute function ``q`` of the potential and its derivative by ``u`` (section 2-7)."""
    turn = np.arctan(_E / u)
    value = 0.5 * ((1.0 + 3.0 * u * u / _E**2) * turn - 3.0 * u / _E)
    slope = 0.5 * (6.0 * u / _E**2 * turn - (1.0 + 3.0 * u * u / _E**2) * _E / (u * u + _E**2) - 3.0 / _E)
    return np.stack([value, slope])


def exact_gravity_n(lat: ArrayLike, height: ArrayLike) -> FloatArray:
    """Compute normal gravity North, East, Down ``(..., 3)`` [m/s^2] at latitudes [rad] and heights [m], exactly.

    It is the gradient of the potential of the rotating level ellipsoid.
    """
    lat, height = np.broadcast_arrays(np.asarray(lat, dtype=float), np.asarray(height, dtype=float))
    x, _, z = pymap3d.geodetic2ecef(lat, np.zeros_like(lat), height, deg=False)
    # ellipsoidal coordinates: u, and the reduced latitude of the confocal ellipsoid through the point
    r2 = x * x + z * z - _E**2
    u = np.sqrt(0.5 * (r2 + np.sqrt(r2 * r2 + 4.0 * _E**2 * z * z)))
    wide = np.sqrt(u * u + _E**2)
    sine, cosine = z / u, x / wide
    (q, slope), q0 = _q(u), _q(_B)[0]
    own = _OMEGA**2 * _A**2 / q0
    by_u = -_GM / wide**2 + 0.5 * own * slope * (sine**2 - 1.0 / 3.0) + _OMEGA**2 * u * cosine**2
    by_beta = (own * q - _OMEGA**2 * wide**2) * sine * cosine
    stretch = np.sqrt(u * u + _E**2 * sine**2) / wide
    along_u, along_beta = by_u / stretch, by_beta / (stretch * wide)
    gx = (along_u * u / wide * cosine - along_beta * sine) / stretch
    gz = (along_u * sine + along_beta * u / wide * cosine) / stretch
    s, c = np.sin(lat), np.cos(lat)
    return np.stack([c * gz - s * gx, np.zeros_like(lat), -c * gx - s * gz], axis=-1)


def gravity() -> list[Check]:
    """Compare gravity at the ellipsoid with published values, and up to 20 km with the exact gradient."""
    lat = np.linspace(-90.0, 90.0, 181) * DEG
    published = max(abs(float(gravity_n(at * DEG, 0.0)[2]) - value) for at, value in PUBLISHED.items())
    surface = np.abs(gravity_n(lat, 0.0) - exact_gravity_n(lat, 0.0))
    checks = [
        Check("gravity", "equator and pole, published", "m/s^2", 1e-8, (("insnav", published),)),
        Check("gravity", "at the ellipsoid, down", "m/s^2", 1e-8, (("insnav", float(surface[:, 2].max())),)),
        Check("gravity", "at the ellipsoid, north", "m/s^2", 1e-8, (("insnav", float(surface[:, 0].max())),)),
    ]
    for height in HEIGHTS:
        error = np.abs(gravity_n(lat, height) - exact_gravity_n(lat, height)).max(axis=0) / UG
        for axis, name in ((2, "down"), (0, "north")):
            values = (("insnav", float(error[axis])),)
            checks.append(Check("gravity", f"{height / 1e3:g} km, {name}", "ug", 1.0, values))
    return checks
