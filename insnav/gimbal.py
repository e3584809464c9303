"""The north-pointing gimballed platform: from specific force along its axes to velocity, position and torquing rates.

The platform is kept level and to the north by torquing its gyros at the rate at which North, East, Down turn against
inertial space, as computed. Its accelerometers so measure along North, East, Down, and nothing needs to be rotated; an
error of its axes, however, comes back as an error of velocity and position, which is how it swings (Schuler).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from insnav.attitude import quat_from_rotvec, rotvec_from_quat
from insnav.earth import earth_rate_n, gravity_n, radii, transport_rate_n
from insnav.exceptions import ConfigError, DivergenceError, InputError
from insnav.kernels import gimbal as _kernel
from insnav.types import FloatArray, Trajectory

Integrator = Literal["forward", "backward", "mean", "fourth"]
Vertical = Literal["off", "free", "damped"]

INTEGRATORS: tuple[Integrator, ...] = get_args(Integrator)
_METHOD = {name: getattr(_kernel, name.upper()) for name in INTEGRATORS}
_VERTICAL = {name: getattr(_kernel, name.upper()) for name in get_args(Vertical)}
DAMPING_TIME = 100.0  # time constant of the damped vertical channel [s]
MAX_TILT = np.radians(10.0)  # a platform farther off points nowhere


@dataclass(frozen=True, slots=True)
class PlatformErrors:
    """What a platform and its sensors do wrong, along North, East, Down."""

    # (3,) turn of the platform's axes at the start, from the true North, East, Down to them [rad]
    tilt: FloatArray = field(default_factory=lambda: np.zeros(3))
    # (3,) rate at which it turns beyond its command [rad/s]. A gyro that shows a rate too large by b makes the servo
    # turn the platform by -b.
    drift: FloatArray = field(default_factory=lambda: np.zeros(3))
    bias: FloatArray = field(default_factory=lambda: np.zeros(3))  # (3,) what its accelerometers show too much [m/s^2]

    @property
    def any(self) -> bool:
        """Whether anything is wrong at all."""
        return bool(np.any(self.tilt) or np.any(self.drift) or np.any(self.bias))


@dataclass(frozen=True, slots=True)
class PlatformRun:
    """What a platform computes."""

    integrator: Integrator
    vertical: Vertical
    solution: Trajectory  # position and velocity; the attitude of the vehicle is not known
    undisturbed: Trajectory  # the same without the platform's errors; `solution` itself if there are none
    tilt: FloatArray  # (n, 3) turn of the platform's axes from the true North, East, Down to them [rad]


def navigate_platform(
    time: FloatArray,
    f_n: FloatArray,
    lla: FloatArray,
    v_n: FloatArray,
    *,
    integrator: Integrator = "fourth",
    vertical: Vertical = "off",
    height: FloatArray | None = None,
    errors: PlatformErrors | None = None,
    gravity: float | None = None,
    every: int = 1,
) -> PlatformRun:
    """Integrate the specific force measured on a north-pointing platform.

    `time` (n,): of the samples [s], strictly increasing; each step has its own length. `f_n` (n, 3): specific force
    North, East, Down at these instants [m/s^2]. With the vertical channel off Down may be ``NaN`` throughout: gravity
    at the start then stands for it. `lla`, `v_n` (3,): latitude, longitude [rad], height [m]; velocity North, East,
    Down [m/s] at the first time.

    `integrator`: ``forward`` takes the rates of the state as they are at the start of each step (Euler), ``backward``
    as they are at its end, ``mean`` the mean of both, ``fourth`` is the classical Runge-Kutta method of fourth order.
    It needs the specific force half-way: a polynomial through the six samples around it gives that.

    `vertical`: ``off``: height as at the start, no vertical velocity. ``free``: integrated like the others, its error
    with an e-folding time of 570 s. ``damped``: drawn to `height` (n,) [m] by a loop of third order with three equal
    time constants of `DAMPING_TIME`, ``k1 = 3/T, k2 = 3/T^2 + 2 g/R, k3 = 1/T^3``.

    `errors`: what the platform does wrong. The samples then are those of a platform without these errors. `gravity`: of
    this size everywhere, straight down [m/s^2]; by default normal gravity, which above the ellipsoid has a part to the
    north (7 m in ten minutes at a height of 5 km). `every`: return every so-manieth sample, beginning with the first.

    Raises: ConfigError: the start is within 6 km of a pole, there is no height to damp with or one too many, a vertical
    velocity without a vertical channel, or a tilt beyond 10 deg; InputError: too few samples, times that do not
    increase, or values that are no numbers; DivergenceError: the solution left the Earth, came within 6 km of a pole,
    where there is no north to point to, or the free vertical channel ran away.

    Notes
    -----
    A fourth-order method could step over two samples instead, and use the one between as the middle. With the
    polynomial it is measured to be 16 times better on smooth motion, gives every sample, and takes uneven steps.

    References
    ----------
    Britting, "Inertial Navigation Systems Analysis", 1971, chapter on the local-level system; Groves (2013), section
    5.4. Damping: Siouris, "Aerospace Avionics Systems", 1993, section on the vertical channel.
    """
    time, f_n = np.ascontiguousarray(time, dtype=float), np.asarray(f_n, dtype=float)
    errors = errors or PlatformErrors()
    _refuse_start(lla, v_n, vertical, height, errors)
    if vertical == "off" and len(f_n) and np.isnan(f_n[:, 2]).all():
        g_down = gravity_n(lla[0], lla[2])[2] if gravity is None else gravity
        f_n = np.column_stack([f_n[:, :2], np.full(len(f_n), -g_down)])
    samples = np.column_stack([f_n, np.zeros(len(f_n)) if height is None else height])
    _refuse_samples(time, samples)
    mid = np.empty((len(time) - 1, 4))
    _kernel.midpoints(time, samples, mid)
    start = np.concatenate([lla, v_n, [0.0]])
    y = np.concatenate([start, start, quat_from_rotvec(errors.tilt)])
    out = np.empty((1 + (len(time) - 1) // every, _kernel.STATES))
    done = _kernel.navigate(
        _METHOD[integrator],
        time,
        samples,
        mid,
        _VERTICAL[vertical],
        np.append(damping_gains(lla), np.nan if gravity is None else gravity),
        errors.any,
        np.concatenate([errors.drift, errors.bias]),
        y,
        every,
        out,
    )
    if done < len(time) - 1:
        raise _left(time[done], y, vertical, errors.any)
    at = time[::every]
    unknown = np.full((len(at), 3), np.nan)
    first = _kernel.COMPUTED
    undisturbed = Trajectory(at, out[:, :3], out[:, 3:6], unknown)
    if not errors.any:
        return PlatformRun(integrator, vertical, undisturbed, undisturbed, np.zeros((len(at), 3)))
    solution = Trajectory(at, out[:, first : first + 3], out[:, first + 3 : first + 6], unknown)
    return PlatformRun(integrator, vertical, solution, undisturbed, rotvec_from_quat(out[:, _kernel.TURN :]))


def torquing_rates(solution: Trajectory) -> FloatArray:
    """Rates at which the gyros of a north-pointing platform are torqued: Earth rate plus transport rate.

    Returns: (n, 3): about North, East, Down [rad/s]: ``W cos L + vE / (Rx + h)``, ``-vN / (Ry + h)`` and
    ``-(W sin L + vE tan L / (Rx + h))`` (Groves 2013, eq. 2.123, 5.44).
    """
    lla, v_n = solution.lla, solution.v_n
    return earth_rate_n(lla[:, 0]) + transport_rate_n(lla[:, 0], lla[:, 2], v_n)


def damping_gains(lla: FloatArray) -> FloatArray:
    """Gains of the damped vertical channel at a place ``(3,)``: latitude [rad], longitude, height [m].

    Returns: (3,): ``k1`` [1/s], ``k2`` [1/s^2], ``k3`` [1/s^3]: the errors of height, vertical velocity and
    acceleration obey ``s^3 + k1 s^2 + (k2 - 2 g/R) s + k3 = 0``, which they make ``(s + 1/T)^3``.
    """
    rate = 1.0 / DAMPING_TIME
    mean = float(np.sqrt(np.prod(radii(lla[0]))))
    return np.array([3.0 * rate, 3.0 * rate**2 + 2.0 * gravity_n(lla[0], lla[2])[2] / mean, rate**3])


def integral(time: FloatArray, values: FloatArray, integrator: Integrator) -> FloatArray:
    """Integrate a sampled function by the rule that an integrator of the platform comes down to.

    `time`, `values` (n,): times [s] and values there. `integrator`: rectangle with the height at its start or its end,
    trapezoid, Simpson's rule with the polynomial's middle.
    Returns: (n,): integral from the first time on.
    """
    time = np.ascontiguousarray(time, dtype=float)
    columns = np.asarray(values, dtype=float)[:, None].copy()
    mid, out = np.empty((len(time) - 1, 1)), np.empty(len(time))
    _kernel.midpoints(time, columns, mid)
    _kernel.quadrature(_METHOD[integrator], time, columns[:, 0], mid[:, 0], out)
    return out


def _refuse_start(
    lla: FloatArray, v_n: FloatArray, vertical: Vertical, height: FloatArray | None, errors: PlatformErrors
) -> None:
    if np.cos(lla[0]) <= _kernel.NEAREST_POLE or abs(lla[0]) > 0.5 * np.pi:
        raise ConfigError("platform.start_near_pole", where="latitude", lat_rad=float(lla[0]))
    if (vertical == "damped") != (height is not None):
        raise ConfigError("platform.no_height" if vertical == "damped" else "platform.unused_height", where="height")
    if vertical == "off" and v_n[2] != 0.0:
        raise ConfigError("platform.vertical_velocity", where="velocity", up_m_s=-float(v_n[2]))
    if np.linalg.norm(errors.tilt) > MAX_TILT:
        raise ConfigError(
            "platform.not_level", where="tilt", tilt_rad=float(np.linalg.norm(errors.tilt)), limit_rad=MAX_TILT
        )


def _refuse_samples(time: FloatArray, samples: FloatArray) -> None:
    if len(time) < 2:
        raise InputError("platform.few_samples", count=len(time))
    if not np.isfinite(samples).all():
        row = int(np.flatnonzero(~np.isfinite(samples).all(axis=1))[0])
        raise InputError("platform.not_finite", where=f"t = {time[row]:.6f} s")
    if not np.all(np.diff(time) > 0.0):
        row = int(np.flatnonzero(~(np.diff(time) > 0.0))[0])
        raise InputError("platform.not_increasing", where=f"t = {time[row + 1]:.6f} s")


def _left(time: float, y: FloatArray, vertical: Vertical, disturbed: bool) -> DivergenceError:
    """Say where the solution stopped to make sense."""
    where = f"t = {time:.3f} s"
    for first in (0, _kernel.COMPUTED):
        if not abs(y[first + 2]) < _kernel.HIGHEST:
            return DivergenceError(
                "platform.free_height" if vertical == "free" else "platform.height",
                where=where,
                height_m=float(y[first + 2]),
            )
    # the state that is farther north or south is the one that stopped
    lat = max((y[0], y[_kernel.COMPUTED]) if disturbed else (y[0],), key=abs)
    return DivergenceError(
        "platform.near_pole_with_errors" if disturbed else "platform.near_pole", where=where, lat_rad=float(lat)
    )
