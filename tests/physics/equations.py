"""The navigation equations in continuous time, written out once more, and errors as the filter defines them.

Nothing of insnav is used: position as latitude, longitude, height; attitude as a matrix; Groves (2013), section 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

A_AXIS, FLATTENING, OMEGA = 6378137.0, 1 / 298.257223563, 7.292115e-5
E2 = FLATTENING * (2 - FLATTENING)


@dataclass
class State:
    """Latitude, longitude [rad], height [m]; velocity N, E, D [m/s]; C_nb. Also used for their time derivatives."""

    lla: np.ndarray
    v: np.ndarray
    c: np.ndarray

    def plus(self, rate: State, dt: float) -> State:
        return State(self.lla + dt * rate.lla, self.v + dt * rate.v, self.c + dt * rate.c)


def radii(lat: float) -> tuple[float, float]:
    w = np.sqrt(1 - E2 * np.sin(lat) ** 2)
    return A_AXIS * (1 - E2) / w**3, A_AXIS / w


def gravity(lat: float, h: float) -> np.ndarray:
    s2 = np.sin(lat) ** 2
    surface = 9.7803253359 * (1 + 0.00193185265241 * s2) / np.sqrt(1 - E2 * s2)
    down = surface * (
        1 - 2 / A_AXIS * (1 + FLATTENING + 0.00344978650684 - 2 * FLATTENING * s2) * h + 3 * (h / A_AXIS) ** 2
    )
    return np.array([-8.08e-9 * h * np.sin(2 * lat), 0.0, down])


def axes_of(lat: np.ndarray, lon: np.ndarray) -> np.ndarray:
    """``C_en``, columns North, East, Down in Earth-fixed axes ``(n, 3, 3)`` (Groves 2013, eq. 2.150)."""
    s, c, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    north, east = np.stack([-s * cl, -s * sl, c], -1), np.stack([-sl, cl, np.zeros_like(s)], -1)
    return np.stack([north, east, np.stack([-c * cl, -c * sl, -s], -1)], axis=-1)


def cross(v: np.ndarray) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def derivative(x: State, w_ib_b: np.ndarray, f_b: np.ndarray) -> State:
    lat, _, h = x.lla
    meridian, transverse = radii(lat)
    d_lat, d_lon = x.v[0] / (meridian + h), x.v[1] / ((transverse + h) * np.cos(lat))
    w_ie = OMEGA * np.array([np.cos(lat), 0, -np.sin(lat)])
    w_en = np.array([d_lon * np.cos(lat), -d_lat, -d_lon * np.sin(lat)])
    v = x.c @ f_b + gravity(lat, h) - np.cross(2 * w_ie + w_en, x.v)
    return State(np.array([d_lat, d_lon, -x.v[2]]), v, x.c @ cross(w_ib_b) - cross(w_ie + w_en) @ x.c)


def advance(x: State, w_ib_b: np.ndarray, f_b: np.ndarray, dt: float, steps: int) -> State:
    """Classical Runge-Kutta with constant rate and specific force."""
    h = dt / steps
    for _ in range(steps):
        a = derivative(x, w_ib_b, f_b)
        b = derivative(x.plus(a, h / 2), w_ib_b, f_b)
        c = derivative(x.plus(b, h / 2), w_ib_b, f_b)
        d = derivative(x.plus(c, h), w_ib_b, f_b)
        x = x.plus(a, h / 6).plus(b, h / 3).plus(c, h / 3).plus(d, h / 6)
    return x


def metres(x: State) -> np.ndarray:
    """What a radian of latitude, of longitude, and a metre of height are in North, East, Down [m]."""
    meridian, transverse = radii(x.lla[0])
    return np.array([meridian + x.lla[2], (transverse + x.lla[2]) * np.cos(x.lla[0]), -1.0])


def disturbed(x: State, error: np.ndarray) -> State:
    """Estimate with the given error: position [m], velocity [m/s], phi [rad] with C_hat = (I - [phi x]) C."""
    return State(x.lla + error[:3] / metres(x), x.v + error[3:6], (np.eye(3) - cross(error[6:9])) @ x.c)


def error_of(estimate: State, true: State) -> np.ndarray:
    """Error, (9,); the inverse of `disturbed` to first order."""
    turn = np.eye(3) - estimate.c @ true.c.T
    phi = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.concatenate([(estimate.lla - true.lla) * metres(true), estimate.v - true.v, phi])
