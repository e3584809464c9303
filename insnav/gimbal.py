"""North-pointing gimballed platform: velocity, position and torquing rates from specific force along its axes.

Torquing its gyros at the computed rate of North, East, Down in inertial space keeps the platform level and
north-pointing. Its accelerometers thus measure along North, East, Down, and no vector needs to be rotated. A tilt of
the platform causes velocity and position errors, which change the torquing rate and the tilt: a Schuler oscillation.
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
MAX_TILT = np.radians(10.0)  # a platform with a larger tilt is unusable


@dataclass(frozen=True, slots=True)
class PlatformErrors:
    """Errors of a platform and its sensors, along North, East, Down."""

    # (3,) initial rotation from the true North, East, Down to the platform's axes [rad]
    tilt: FloatArray = field(default_factory=lambda: np.zeros(3))
    # (3,) rotation rate beyond the commanded rate [rad/s]; a gyro bias of b makes the servo rotate the platform at -b
    drift: FloatArray = field(default_factory=lambda: np.zeros(3))
    bias: FloatArray = field(default_factory=lambda: np.zeros(3))  # (3,) accelerometer bias [m/s^2]

    @property
    def any(self) -> bool:
        """Return whether any error is nonzero."""
        return bool(np.any(self.tilt) or np.any(self.drift) or np.any(self.bias))


@dataclass(frozen=True, slots=True)
class PlatformRun:
    """Result of a platform integration."""

    integrator: Integrator
    vertical: Vertical
    solution: Trajectory  # position and velocity; the vehicle attitude is unknown
    undisturbed: Trajectory  # without the platform's errors; `solution` itself if they are zero
    tilt: FloatArray  # (n, 3) rotation from the true North, East, Down to the platform's axes [rad]


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
    North, East, Down at these instants [m/s^2]. Without vertical channel, Down may be ``NaN`` throughout: gravity at
    the start replaces it. `lla` (3,): initial latitude, longitude [rad], height [m]. `v_n` (3,): initial velocity
    North, East, Down [m/s].

    `integrator`: ``forward`` uses the rates at the start of each step (Euler), ``backward`` the rates at its end,
    ``mean`` the mean of both. ``fourth`` is the classical fourth-order Runge-Kutta method. It needs the specific force
    half-way, from a polynomial through the six nearest samples.

    `vertical`: ``off``: constant height, no vertical velocity. ``free``: integrated like the others, unstable with an
    e-folding time of 570 s. ``damped``: controlled to `height` (n,) [m] by a third-order loop with three equal time
    constants of `DAMPING_TIME`, ``k1 = 3/T, k2 = 3/T^2 + 2 g/R, k3 = 1/T^3``.

    `errors`: of the platform, to simulate; `f_n` contains no platform errors. `gravity`: constant magnitude, straight
    down [m/s^2]. By default normal gravity, which has a north component above the ellipsoid (7 m in ten minutes at a
    height of 5 km). `every`: decimation of the returned samples, from the first on.

    Raises: ConfigError: the start is within 6 km of a pole, or the tilt beyond 10 deg. The damping height is missing or
    unnecessary, or there is a vertical velocity without a vertical channel. InputError: too few samples, times that do
    not increase, or NaN values. DivergenceError: the solution left the Earth, came within 6 km of a pole, or the free
    vertical channel diverged.

    Notes
    -----
    A fourth-order method could instead use steps of two samples, with the sample between them as the middle. In tests
    on smooth motion, the polynomial is 16 times more accurate. It also gives every sample, and accepts uneven steps.

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
    state = np.concatenate([start, start, quat_from_rotvec(errors.tilt)])
    out = np.empty((1 + (len(time) - 1) // every, _kernel.STATES))
    channel = _VERTICAL[vertical], np.append(damping_gains(lla), np.nan if gravity is None else gravity)
    disturbance = errors.any, np.concatenate([errors.drift, errors.bias])
    steps = _kernel.navigate(_METHOD[integrator], time, samples, mid, *channel, *disturbance, state, every, out)
    if steps < len(time) - 1:
        raise _left(time[steps], state, vertical, errors.any)
    times = time[::every]
    unknown = np.full((len(times), 3), np.nan)
    first = _kernel.COMPUTED
    undisturbed = Trajectory(times, out[:, :3], out[:, 3:6], unknown)
    if not errors.any:
        return PlatformRun(integrator, vertical, undisturbed, undisturbed, np.zeros((len(times), 3)))
    solution = Trajectory(times, out[:, first : first + 3], out[:, first + 3 : first + 6], unknown)
    return PlatformRun(integrator, vertical, solution, undisturbed, rotvec_from_quat(out[:, _kernel.TURN :]))


def torquing_rates(solution: Trajectory) -> FloatArray:
    """Compute the torquing rates of a north-pointing platform's gyros: Earth rate plus transport rate.

    Returns: (n, 3): about North, East, Down [rad/s]: ``W cos L + vE / (Rx + h)``, ``-vN / (Ry + h)`` and
    ``-(W sin L + vE tan L / (Rx + h))`` (Groves 2013, eq. 2.123, 5.44).
    """
    lla, v_n = solution.lla, solution.v_n
    return earth_rate_n(lla[:, 0]) + transport_rate_n(lla[:, 0], lla[:, 2], v_n)


def damping_gains(lla: FloatArray) -> FloatArray:
    """Compute the gains of the damped vertical channel at a place ``(3,)``: latitude [rad], longitude, height [m].

    Returns: (3,): ``k1`` [1/s], ``k2`` [1/s^2], ``k3`` [1/s^3]. The errors of height, vertical velocity and
    acceleration obey ``s^3 + k1 s^2 + (k2 - 2 g/R) s + k3 = 0``, equal to ``(s + 1/T)^3``.
    """
    rate = 1.0 / DAMPING_TIME
    radius = float(np.sqrt(np.prod(radii(lla[0]))))
    return np.array([3.0 * rate, 3.0 * rate**2 + 2.0 * gravity_n(lla[0], lla[2])[2] / radius, rate**3])


def integral(time: FloatArray, values: FloatArray, integrator: Integrator) -> FloatArray:
    """Integrate a sampled function by the quadrature rule of a platform integrator.

    `time`, `values` (n,): times [s] and values. `integrator`: rectangle rule with the initial (``forward``) or final
    value (``backward``), trapezoid rule (``mean``), or Simpson's rule with an interpolated midpoint (``fourth``).
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
    """Build the error for a solution that left the allowed heights or latitudes."""
    where = f"t = {time:.3f} s"
    for first in (0, _kernel.COMPUTED):
        if not abs(y[first + 2]) < _kernel.HIGHEST:
            return DivergenceError(
                "platform.free_height" if vertical == "free" else "platform.height",
                where=where,
                height_m=float(y[first + 2]),
            )
    # of the solutions without and with errors, the one nearer to a pole stopped the integration
    lat = max((y[0], y[_kernel.COMPUTED]) if disturbed else (y[0],), key=abs)
    return DivergenceError(
        "platform.near_pole_with_errors" if disturbed else "platform.near_pole", where=where, lat_rad=float(lat)
    )
