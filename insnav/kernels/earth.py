"""WGS-84 shape, rotation and normal gravity: for one point in a kernel and, undecorated, for arrays.

Every function uses numpy's elementwise functions only. The same source serves the compiled loops and, through
``py_func``, whole arrays in `insnav.earth`.
"""

from __future__ import annotations

import numpy as np

from insnav.kernels import njit

A = 6378137.0  # semi-major axis [m]                                     NIMA TR8350.2 table 3.1
F = 1.0 / 298.257223563  # flattening [-]                                NIMA TR8350.2 table 3.1
E2 = F * (2.0 - F)  # first eccentricity squared [-]
OMEGA = 7.292115e-5  # Earth's rotation rate [rad/s]                     NIMA TR8350.2 table 3.1
G_EQUATOR = 9.7803253359  # normal gravity at the equator [m/s^2]        NIMA TR8350.2 table 3.4
K_SOMIGLIANA = 0.00193185265241  # Somigliana's constant [-]             NIMA TR8350.2 table 3.4
M = 0.00344978650684  # omega^2 a^2 b / GM [-]                           NIMA TR8350.2 table 3.4
G_NORTH = 8.08e-9  # north component above the ellipsoid [1/s^2]         Groves (2013) eq. 2.140


@njit(cache=True)
def radii(sin_lat):  # type: ignore[no-untyped-def]
    """Compute meridian and transverse radius of curvature [m] (Groves 2013, section 2.4.2)."""
    root = 1.0 / np.sqrt(1.0 - E2 * (sin_lat * sin_lat))  # as in `gravity_down`: compiled code shares the expression
    transverse = A * root
    return transverse * (1.0 - E2) * (root * root), transverse


@njit(cache=True)
def gravity_down(sin_lat, height):  # type: ignore[no-untyped-def]
    """Compute the down component of normal gravity [m/s^2] (NIMA TR8350.2, eq. 4-1 and 4-3)."""
    s2 = sin_lat * sin_lat
    surface = G_EQUATOR * (1.0 + K_SOMIGLIANA * s2) * (1.0 / np.sqrt(1.0 - E2 * s2))
    r = height * (1.0 / A)
    return surface * (1.0 - 2.0 * (1.0 + F + M - 2.0 * F * s2) * r + 3.0 * r * r)


@njit(cache=True)
def gravity_north(sin_lat, cos_lat, height):  # type: ignore[no-untyped-def]
    """Compute the north component of normal gravity above the ellipsoid [m/s^2] (Groves 2013, eq. 2.140)."""
    return -2.0 * G_NORTH * height * sin_lat * cos_lat
