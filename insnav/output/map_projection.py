"""Universal Transverse Mercator coordinates on WGS-84.

References
----------
C. F. F. Karney, "Transverse Mercator with an accuracy of a few nanometers", J. Geodesy 85 (2011) 475-485.
NGA.STND.0037, "The universal grids and the transverse Mercator and polar stereographic map projections", 2014: zones.
"""

from __future__ import annotations

import math

import numpy as np

from insnav.kernels.earth import E2, A
from insnav.types import FloatArray
from insnav.units import DEG

UTM_SCALE = 0.9996
_E = math.sqrt(E2)
_N = (1.0 - math.sqrt(1.0 - E2)) / (1.0 + math.sqrt(1.0 - E2))  # third flattening [-]
_RADIUS = A / (1.0 + _N) * (1.0 + _N**2 / 4.0 + _N**4 / 64.0 + _N**6 / 256.0)  # eq. 14 [m]
_ALPHA = (  # eq. 35: rows of coefficients of the powers of n, from the power of the row on
    (1 / 2, -2 / 3, 5 / 16, 41 / 180, -127 / 288, 7891 / 37800),
    (13 / 48, -3 / 5, 557 / 1440, 281 / 630, -1983433 / 1935360),
    (61 / 240, -103 / 140, 15061 / 26880, 167603 / 181440),
    (49561 / 161280, -179 / 168, 6601661 / 7257600),
    (34729 / 80640, -3418889 / 1995840),
    (212378941 / 319334400,),
)


def utm_zone(lat: float, lon: float) -> tuple[int, bool]:
    """Return number of the UTM zone of a position [rad], with its exceptions in Norway, and whether it is southern."""
    north, east = lat / DEG, (lon / DEG + 180.0) % 360.0 - 180.0
    zone = int((east + 180.0) // 6.0) + 1
    if 56.0 <= north < 64.0 and 3.0 <= east < 12.0:
        zone = 32
    elif north >= 72.0 and 0.0 <= east < 42.0:
        zone = 31 + 2 * int((east + 3.0) // 12.0)
    return zone, north < 0.0


def transverse_mercator(lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Project positions onto a transverse Mercator plane with unit scale on its meridian.

    `lat` (n,) [rad]. `lon` (n,): from the central meridian [rad].
    Returns: east, north [m], and meridian convergence [rad]: azimuth minus grid azimuth; (n,) each. Accurate to
    nanometres within 35 deg of the meridian.
    """
    tau, lon = np.tan(lat), (lon + math.pi) % (2.0 * math.pi) - math.pi
    sigma = np.sinh(_E * np.arctanh(_E * tau / np.hypot(1.0, tau)))  # eq. 7-9
    conformal = tau * np.hypot(1.0, sigma) - sigma * np.hypot(1.0, tau)
    xi = np.arctan2(conformal, np.cos(lon))  # eq. 10
    eta = np.arcsinh(np.sin(lon) / np.hypot(conformal, np.cos(lon)))
    north, east, p, q = xi.copy(), eta.copy(), np.ones_like(xi), np.zeros_like(xi)
    for j, row in enumerate(_ALPHA, 1):
        alpha = sum(each * _N ** (j + k) for k, each in enumerate(row))
        north += alpha * np.sin(2 * j * xi) * np.cosh(2 * j * eta)  # eq. 11
        east += alpha * np.cos(2 * j * xi) * np.sinh(2 * j * eta)
        p += 2 * j * alpha * np.cos(2 * j * xi) * np.cosh(2 * j * eta)  # eq. 12
        q += 2 * j * alpha * np.sin(2 * j * xi) * np.sinh(2 * j * eta)
    convergence = np.arctan2(conformal * np.tan(lon), np.hypot(1.0, conformal)) + np.arctan2(q, p)  # eq. 23
    return _RADIUS * east, _RADIUS * north, convergence
