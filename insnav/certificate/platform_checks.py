"""Integrators of the north-pointing platform: order of convergence, and motions with closed-form results."""

from __future__ import annotations

import numpy as np
import pymap3d
from numpy.typing import ArrayLike

from insnav.certificate.integrators import Check
from insnav.certificate.motions import even, swell
from insnav.certificate.strapdown_checks import DAY, ERRORS, PLACE, compared
from insnav.earth import earth_rate_n, gravity_n, ned_offset
from insnav.errors.platform_errors import Convergence, level_force, sine_convergence
from insnav.gimbal import DAMPING_TIME, Integrator, PlatformRun, Vertical, integral, navigate_platform
from insnav.simulate import Truth, circle, straight
from insnav.types import FloatArray
from insnav.units import DEG, UG

# four defining constants of the ellipsoid, independent of `insnav.earth`
_A, _F, _GM, _OMEGA = 6378137.0, 1.0 / 298.257223563, 3.986004418e14, 7.292115e-5
_B = _A * (1.0 - _F)
_E = np.sqrt(_A * _A - _B * _B)  # linear eccentricity [m]
PUBLISHED = {0.0: 9.7803253359, 90.0: 9.8321849378}  # latitude [deg] -> normal gravity [m/s^2], TR8350.2 table 3.4
HEIGHTS = (1e3, 5e3, 10e3, 20e3)  # heights of the comparison [m]
NAMES: tuple[Integrator, ...] = ("fourth", "mean", "forward", "backward")  # limits apply only to the first integrator
ORDERS = {"fourth": 4, "mean": 2, "forward": 1, "backward": 1}
RATE = 10.0  # sampling rate [Hz]
_TOPIC = "platform"
_STEPS = (8.0, 4.0, 2.0, 1.0)  # steps on a turn, so coarse that fourth-order errors exceed rounding [s]
_DAY_STEP = 10.0  # coarse, so that the plain integrators differ visibly [s]
_HOUR = 3600.0


def _q(u: FloatArray | float) -> FloatArray:
    """Compute ``q(u)`` and its derivative (Heiskanen and Moritz, Physical Geodesy, 1967, section 2-7)."""
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
    # ellipsoidal coordinates of a point: u, and the reduced latitude on the confocal ellipsoid through the point
    r2 = x * x + z * z - _E**2
    u = np.sqrt(0.5 * (r2 + np.sqrt(r2 * r2 + 4.0 * _E**2 * z * z)))
    wide = np.sqrt(u * u + _E**2)
    sine, cosine = z / u, x / wide
    (q, slope), q0 = _q(u), _q(_B)[0]
    coefficient = _OMEGA**2 * _A**2 / q0
    by_u = -_GM / wide**2 + 0.5 * coefficient * slope * (sine**2 - 1.0 / 3.0) + _OMEGA**2 * u * cosine**2
    by_beta = (coefficient * q - _OMEGA**2 * wide**2) * sine * cosine
    stretch = np.sqrt(u * u + _E**2 * sine**2) / wide
    along_u, along_beta = by_u / stretch, by_beta / (stretch * wide)
    gx = (along_u * u / wide * cosine - along_beta * sine) / stretch
    gz = (along_u * sine + along_beta * u / wide * cosine) / stretch
    s, c = np.sin(lat), np.cos(lat)
    return np.stack([c * gz - s * gx, np.zeros_like(lat), -c * gx - s * gz], axis=-1)


def gravity() -> list[Check]:
    """Compare gravity at the ellipsoid with published values, and up to 20 km with the exact gradient."""
    lat = np.linspace(-90.0, 90.0, 181) * DEG
    published = max(abs(float(gravity_n(degrees * DEG, 0.0)[2]) - value) for degrees, value in PUBLISHED.items())
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


def platform() -> list[Check]:
    """Execute all checks of the platform mechanization."""
    return [*orders(), *flights(), *date_line(), *vertical(), *day()]


def orders() -> list[Check]:
    """Check the integral of a line, and error orders on a sine and a turn. Order limits apply to all integrators."""
    x = np.linspace(0.0, 3.0, 31)
    line = tuple((name, abs(float(integral(x, 2.0 * x, name)[-1]) - 9.0)) for name in NAMES)
    sine = {each.integrator: each.order for each in sine_convergence()}
    turn = circle(np.array([48.0 * DEG, 11.0 * DEG, 3000.0]), 150.0, 0.02, 320.0)
    errors = {name: [_worst(turn, even(turn.duration, 1.0 / step), name) for step in _STEPS] for name in NAMES}
    circles = {name: Convergence(name, np.array(_STEPS), np.array(each)).order for name, each in errors.items()}
    checks = [Check(_TOPIC, "y = 2x from 0 to 3 in 30 steps, error of 9", "1", 1e-12, line)]
    for case, found in (("y = sin t", sine), ("circles at 150 m/s", circles)):
        difference = tuple((name, abs(found[name] - ORDERS[name])) for name in NAMES)
        checks.append(Check(_TOPIC, f"order on {case}, off 4, 2, 1, 1", "1", 0.1, difference, required=len(NAMES)))
    return checks


def flights() -> list[Check]:
    """Check the largest error on closed-form motions, one with free vertical channel."""
    place = np.array([48.0 * DEG, 11.0 * DEG, 500.0])
    motions: tuple[tuple[str, Truth, Vertical], ...] = (
        ("1 h of circles at 20 m/s", circle(place, 20.0, 0.1, _HOUR), "off"),
        ("1 h at 250 m/s due east", straight(place, 250.0, np.pi / 2, _HOUR), "off"),
        ("5 min on a swell, vertical channel free", swell(300.0, place), "free"),
    )
    checks = []
    for case, truth, vertical in motions:
        values = tuple((name, _worst(truth, even(truth.duration, RATE), name, vertical)) for name in NAMES)
        checks.append(Check(_TOPIC, case, "m", 0.03, values))
    return checks


def date_line() -> list[Check]:
    """Compare the same motion across the date line and across longitude 57 deg."""
    values = []
    for name in NAMES:
        tracks = []
        for lon in (1.0, np.pi):
            truth, time = circle(np.array([0.8, lon, 100.0]), 20.0, 0.1, 120.0), even(120.0, RATE)
            tracks.append(_flown(truth, time, name).solution.lla)
        difference = np.abs(ned_offset(tracks[1], tracks[0] + np.array([0.0, np.pi - 1.0, 0.0]))).max()
        values.append((name, np.inf if np.any(np.abs(tracks[1][:, 1]) > np.pi) else float(difference)))
    return [Check(_TOPIC, "crossing the date line", "m", 1e-6, tuple(values))]


def vertical() -> list[Check]:
    """Check the height after an initial error of 1 m at rest: unstable, or decaying by the damping loop.

    A rising vehicle also drifts west, the larger effect: ``x'' = k^2 x - (2 W cos L)^2 (x - 1)``, where ``k^2`` is the
    decrease of gravity with height.
    """
    step = 1e-3
    time = even(1200.0, RATE)
    force = np.tile(-gravity_n(PLACE[0], PLACE[2]), (time.size, 1))
    g = [float(gravity_n(PLACE[0], PLACE[2] + d)[2]) for d in (-step, step)]
    coriolis = (2.0 * float(earth_rate_n(PLACE[0])[0])) ** 2
    square = (g[0] - g[1]) / (2.0 * step) - coriolis
    growth = (1.0 + coriolis / square) * np.cosh(np.sqrt(square) * time) - coriolis / square
    # damped channel with three equal roots -1/T: height error x(0) = 1, x'(0) = -3/T, x''(0) = 6/T^2
    scaled = time / DAMPING_TIME
    decay = np.exp(-scaled) * (1.0 - 2.0 * scaled + 0.5 * scaled**2)
    start, zero = PLACE + np.array([0.0, 0.0, 1.0]), np.zeros(3)
    checks = []
    channels: tuple[tuple[Vertical, FloatArray], ...] = (("free", growth), ("damped", decay))
    for mode, expected in channels:
        height = np.full(time.size, PLACE[2]) if mode == "damped" else None
        values = []
        for name in NAMES:
            run = navigate_platform(time, force, start, zero, integrator=name, vertical=mode, height=height)
            values.append((name, float(np.abs(run.solution.lla[:, 2] - PLACE[2] - expected).max())))
        checks.append(Check(_TOPIC, f"height 1 m off for 20 min, channel {mode}", "m", 1e-3, tuple(values)))
    return checks


def day() -> list[Check]:
    """Compare the errors of a platform at rest with their closed form."""
    time = even(DAY, 1.0 / _DAY_STEP)
    force = np.tile(-gravity_n(PLACE[0], PLACE[2]), (time.size, 1))
    records = []
    for name in NAMES:
        run = navigate_platform(time, force, PLACE, np.zeros(3), integrator=name, errors=ERRORS, every=6)
        records.append((name, run.solution.time, ned_offset(run.solution.lla, PLACE)[:, :2]))
    return compared(_TOPIC, records, "a day at rest with errors: ")


def _flown(truth: Truth, time: FloatArray, name: Integrator, vertical: Vertical = "off") -> PlatformRun:
    start = truth.evaluate(time[:1])
    return navigate_platform(
        time, level_force(truth, time), start.lla[0], start.v_n[0], integrator=name, vertical=vertical
    )


def _worst(truth: Truth, time: FloatArray, name: Integrator, vertical: Vertical = "off") -> float:
    """Compute the largest distance from the truth [m]."""
    error = ned_offset(_flown(truth, time, name, vertical).solution.lla, truth.evaluate(time).lla)
    return float(np.linalg.norm(error, axis=1).max())
