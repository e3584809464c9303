"""How the errors of an inertial navigator at rest swing over a day: closed form, and the periods in a record of them.

The error of a level, north-pointing navigator, vertical channel off, is the sum of what two things do. The axes of the
computer's idea of inertial space, off by ``psi``, turn with the Earth once a day and at the drift of the gyros. And the
horizontal position swings about where these axes and the accelerometers draw it, as a Foucault pendulum of the length
of the Earth's radius would: once in 84 minutes, in a plane that turns at the Earth's rate times the sine of latitude.

References
----------
Britting, "Inertial Navigation Systems Analysis", 1971, chapters on the error equations in the general and the local
level form; Groves (2013), section 14.2 for the equations, section 5.7 for their behaviour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from insnav.earth import OMEGA_EARTH, gravity_n, radii
from insnav.exceptions import ConfigError, InputError
from insnav.gimbal import PlatformErrors
from insnav.types import FloatArray

FAINT = 0.01  # a motion smaller than this part of the whole has no period to measure
SEARCH = 0.1  # periods are looked for within this part of those expected
ComplexArray = NDArray[np.complex128]
SHORTEST_RECORD = 0.5  # of a day: a shorter record does not tell the slow oscillations apart


@dataclass(frozen=True, slots=True)
class Periods:
    """Periods of the error oscillations [s].

    Attributes
    ----------
    schuler : float
        Of the pendulum of the Earth's radius, ``2 pi sqrt(R / g)``.
    foucault : float
        In which the plane of that swing turns once.
    earth : float or None
        Of the Earth's rotation; None if the record does not show it.
    """

    schuler: float
    foucault: float
    earth: float | None


@dataclass(frozen=True, slots=True)
class StaticErrors:
    """Errors of a navigator at rest over time.

    Attributes
    ----------
    time : (n,) array
        Since the start [s].
    position, velocity : (n, 2) array
        North, East [m], [m/s].
    tilt : (n, 3) array
        Turn from the true North, East, Down to the navigator's axes [rad].
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    tilt: FloatArray


def periods(lat: float, height: float) -> Periods:
    """Periods of the error oscillations at rest.

    Parameters
    ----------
    lat, height : float
        Latitude [rad] and height [m].

    Raises
    ------
    ConfigError
        On the equator, where the plane of the swing does not turn.

    Notes
    -----
    ``s^2 - 2 i W sin(L) s + g/R = 0`` has the roots ``i (W sin(L) +- sqrt(W^2 sin^2(L) + g/R))``: their mean is the
    Foucault rate, half their difference the rate of the swing. R is the geometric mean of both radii of curvature.
    """
    rate, swing = _pendulum(lat, height)
    if rate == 0.0:
        raise ConfigError("on the equator there is no Foucault period", where="latitude")
    return Periods(2.0 * np.pi / swing, 2.0 * np.pi / abs(rate), 2.0 * np.pi / OMEGA_EARTH)


def static_errors(time: FloatArray, lat: float, height: float, errors: PlatformErrors) -> StaticErrors:
    """Errors of a level, north-pointing navigator at rest with the vertical channel off, in closed form.

    Parameters
    ----------
    time : (n,) array
        Times since the start [s].
    lat, height : float
        Latitude [rad] and height [m] of the place.
    errors : PlatformErrors
        Tilt and heading error at the start, drift and bias, all constant; position and velocity start right.

    Returns
    -------
    StaticErrors

    Notes
    -----
    To first order in the errors and exact but for one thing: the Earth has one radius here, the geometric mean of
    both, which differ by 0.7 % on the equator and not at all at the poles. With ``psi = phi - dtheta``, phi the tilt
    and dtheta the error of position as a rotation, ``psi' = -w_ie x psi + d``; and with ``z = x_N + i x_E``,
    ``z'' - 2 i W sin(L) z' + g/R z = -i g (psi_N + i psi_E) + b_N + i b_E``. The first has a solution with terms 1, t,
    exp(i W t), exp(-i W t); each gives a term of the solution of the second, and the pendulum's own two swings make
    position and velocity zero at the start.
    """
    t = np.asarray(time, dtype=float)
    lat = float(lat)
    radius, g = _radius(lat, height), float(gravity_n(lat, height)[2])
    rate, swing = _pendulum(lat, height)
    stiffness = g / radius
    omega = OMEGA_EARTH
    axis = np.array([np.cos(lat), 0.0, -np.sin(lat)])

    # psi(t) = constant + slope t + cosine cos(W t) + sine sin(W t)
    along_tilt, along_drift = axis * (axis @ errors.tilt), axis * (axis @ errors.drift)
    across_drift = np.cross(axis, errors.drift) / omega
    constant = along_tilt - across_drift
    slope = along_drift
    cosine = errors.tilt - along_tilt + across_drift
    sine = -np.cross(axis, errors.tilt) + (errors.drift - along_drift) / omega
    phase = omega * t[:, None]
    psi = constant + slope * t[:, None] + cosine * np.cos(phase) + sine * np.sin(phase)

    def pull(vector: FloatArray) -> complex:
        return complex(-1j * g * (vector[0] + 1j * vector[1]))

    push = complex(errors.bias[0] + 1j * errors.bias[1])
    steady, ramp = (pull(constant) + push) / stiffness, pull(slope) / stiffness
    steady += 2j * rate * ramp / stiffness
    turning = {  # exp(i nu t) -> its share of the forcing over that of the response
        nu: 0.5 * (pull(cosine) - sign * 1j * pull(sine)) / (stiffness - nu**2 + 2.0 * rate * nu)
        for sign, nu in ((1.0, omega), (-1.0, -omega))
    }
    own = (rate + swing, rate - swing)
    left, left_rate = -(steady + sum(turning.values())), -(ramp + sum(1j * nu * c for nu, c in turning.items()))
    # c0 + c1 = left, i own0 c0 + i own1 c1 = left_rate
    first = (left_rate - 1j * own[1] * left) / (1j * (own[0] - own[1]))
    terms = {**turning}
    z = steady + ramp * t
    z_rate = np.full(t.shape, ramp, dtype=complex)
    for nu, size in (*terms.items(), (own[0], first), (own[1], left - first)):
        wave = size * np.exp(1j * nu * t)
        z, z_rate = z + wave, z_rate + 1j * nu * wave
    north, east = z.real, z.imag
    # dtheta = (dlon cos L, -dL, -dlon sin L)
    moved = np.column_stack([east, -north, -east * np.tan(lat)]) / radius
    return StaticErrors(
        t, np.column_stack([north, east]), np.column_stack([z_rate.real, z_rate.imag]), np.asarray(psi + moved)
    )


def measured_periods(time: FloatArray, position: FloatArray, lat: float, height: float) -> Periods:
    """Periods found in a record of position errors at rest, by least squares.

    Parameters
    ----------
    time : (n,) array
        Since the start [s].
    position : (n, 2) array
        Error North, East [m].
    lat, height : float
        Latitude [rad] and height [m]: where the search begins.

    Returns
    -------
    Periods

    Raises
    ------
    InputError
        The record is shorter than half a day.

    Notes
    -----
    ``x_N + i x_E`` is fitted by a constant, a ramp and four circular motions, two of the swing and two of the Earth's
    rate; the three rates are free within a tenth, and so are all amplitudes. Nothing of the closed form's amplitudes
    is used. An accelerometer bias alone makes no motion at the Earth's rate, which then has no period.
    """
    if time[-1] - time[0] < SHORTEST_RECORD * 86400.0:
        raise InputError(
            "the record is too short to tell its periods apart",
            why=f"it lasts {(time[-1] - time[0]) / 3600.0:.3g} h; at least {24.0 * SHORTEST_RECORD:g} h are needed",
            fix="make it longer; 24 h show every period once",
        )
    t, z = time - time[0], position[:, 0] + 1j * position[:, 1]
    start = np.array([*_pendulum(lat, height), OMEGA_EARTH])

    def fitted(scale: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        rate, swing, earth = scale * start
        waves = np.exp(1j * np.outer(t, [rate + swing, rate - swing, earth, -earth]))
        basis = np.column_stack([np.ones_like(t), t / t[-1], waves])
        amplitude, *_ = np.linalg.lstsq(basis, z, rcond=None)
        return amplitude, z - basis @ amplitude

    def residual(scale: FloatArray) -> FloatArray:
        rest = fitted(scale)[1]
        return np.concatenate([rest.real, rest.imag])

    bounds = (np.full(3, 1.0 - SEARCH), np.full(3, 1.0 + SEARCH))
    scale = least_squares(residual, np.ones(3), bounds=bounds, x_scale=1e-3, xtol=1e-12, ftol=1e-12, gtol=1e-12).x
    size = np.abs(fitted(scale)[0])
    rate, swing, earth = np.abs(scale * start)
    daily = max(size[4:]) > FAINT * max(size[2:])
    return Periods(2.0 * np.pi / swing, 2.0 * np.pi / rate, 2.0 * np.pi / earth if daily else None)


def _radius(lat: float, height: float) -> float:
    return float(np.sqrt(np.prod(np.array(radii(lat)) + height)))


def _pendulum(lat: float, height: float) -> tuple[float, float]:
    """Rate at which the plane of the swing turns, and of the swing as seen from it [rad/s]."""
    rate = OMEGA_EARTH * float(np.sin(lat))
    return rate, float(np.sqrt(rate**2 + gravity_n(lat, height)[2] / _radius(lat, height)))
