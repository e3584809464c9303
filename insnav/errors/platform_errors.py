"""Errors of a platform: integrators on a known motion, oscillations at rest, comparison with strapdown errors.

The error of a level, north-pointing navigator without vertical channel has two parts. The axes of the computed inertial
frame, with the error ``psi``, rotate with the Earth once a day and with the gyro drift. The horizontal position
oscillates about the equilibrium of these axes and the accelerometers, with a period of 84 minutes. It moves like a
Foucault pendulum as long as the Earth's radius, whose plane rotates at the Earth's rate times the sine of latitude.
`static_errors` is the closed form of these errors over time. `measured_periods` estimates the periods from a record.

References
----------
Britting, "Inertial Navigation Systems Analysis", 1971, chapters on the error equations in the general and the local
level form. Groves (2013), section 14.2 for the equations, section 5.7 for their behaviour.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from insnav import strapdown
from insnav.attitude import dcm_from_rph, quat_from_rotvec, quat_from_rph, quat_multiply, rph_from_quat
from insnav.earth import OMEGA_EARTH, gravity_n, ned_offset, radii
from insnav.errors.metrics import TrajectoryErrors, position_errors
from insnav.exceptions import ConfigError, InputError
from insnav.gimbal import INTEGRATORS, Integrator, PlatformErrors, PlatformRun, integral, navigate_platform
from insnav.simulate import Truth, circle, imu_from_truth, reference, straight
from insnav.types import FloatArray, Trajectory
from insnav.units import DEG, DEG_PER_H, UG

FAINT = 0.01  # an oscillation below this share of the largest amplitude has no measurable period [-]
SEARCH = 0.1  # relative search range around the expected periods
ComplexArray = NDArray[np.complex128]
SHORTEST_RECORD = 0.5  # a shorter record does not separate the slow oscillations [days]
SINE_STEPS = (40, 80, 160, 320)  # numbers of steps from 0 to `SINE_END`: errors of all integrators exceed rounding
SINE_END = 5.0
REST_M_S = 0.1  # a slower error-free platform is at rest
AGAINST: Integrator = "fourth"  # reference integrator of the comparison
# inputs of the demonstration
LAT = 45.0 * DEG
HEIGHT, SPEED, ROUND = 5000.0, 150.0, 600.0  # holding pattern: height [m], speed [m/s], time of one circle [s]
FLIGHT, FLIGHT_RATES = 1800.0, (1.0, 10.0, 100.0)  # duration [s] and sampling rates [Hz], in circles
DAY, DAY_RATE = 86400.0, 10.0  # duration [s] and sampling rate [Hz] at rest
PATTERN, PATTERN_RATE = 7200.0, 50.0  # duration [s] and sampling rate [Hz] in circles, compared with strapdown
ERRORS = PlatformErrors(
    tilt=np.array([0.0, 0.0, 1.0 / 60.0]) * DEG,
    drift=np.array([0.01, 0.01, 0.01]) * DEG_PER_H,
    bias=np.array([50.0, 50.0, 0.0]) * UG,
)


@dataclass(frozen=True, slots=True)
class Periods:
    """Periods of the error oscillations [s]."""

    schuler: float  # Schuler oscillation, about ``2 pi sqrt(R / g)`` with the Earth's radius R
    foucault: float  # rotation of the oscillation plane
    earth: float | None  # rotation of the Earth; None if not observable


@dataclass(frozen=True, slots=True)
class StaticErrors:
    """Errors of a stationary navigator as functions of time."""

    time: FloatArray  # (n,) time since the start [s]
    position: FloatArray  # (n, 2) position error North, East [m]
    velocity: FloatArray  # (n, 2) velocity error North, East [m/s]
    tilt: FloatArray  # (n, 3) rotation from the true North, East, Down to the navigator's axes [rad]


def periods(lat: float, height: float) -> Periods:
    """Compute periods of the error oscillations of a stationary navigator.

    `lat`, `height`: latitude [rad] and height [m].
    Raises: ConfigError: on the equator, where the oscillation plane does not rotate.

    Notes
    -----
    ``s^4 + (k_N + k_E + 4 W^2 sin^2(L)) s^2 + k_N k_E = 0`` with ``k = g / R`` of north and east has the roots
    ``+- i (p +- q)``. ``p^2 = W^2 sin^2(L) + (sqrt(k_N) + sqrt(k_E))^2 / 4`` is the oscillation rate and
    ``q^2 = W^2 sin^2(L) + (sqrt(k_N) - sqrt(k_E))^2 / 4`` the rate of its plane. On a sphere q is the Foucault rate
    ``W sin(L)``, on the ellipsoid 0.02 % more at latitude 45 and 1.3 % at latitude 10.
    """
    rate, swing = _pendulum(lat, height)
    if np.sin(lat) == 0.0:
        raise ConfigError("platform.no_foucault", where="latitude")
    return Periods(2.0 * np.pi / swing, 2.0 * np.pi / abs(rate), 2.0 * np.pi / OMEGA_EARTH)


def static_errors(time: FloatArray, lat: float, height: float, errors: PlatformErrors) -> StaticErrors:
    """Compute errors of a level, north-pointing navigator at rest without vertical channel, in closed form.

    `time` (n,): times since the start [s]. `lat`, `height`: latitude [rad] and height [m]. `errors`: initial tilt and
    heading error, constant drift and bias; initial position and velocity are exact.

    Notes
    -----
    Exact to first order in the errors, except for the north component of gravity above the ellipsoid. At 5 km it
    changes the velocity by 2e-4 after a day. With ``psi = phi - dtheta``, tilt phi and position error dtheta as a
    rotation, ``psi' = -w_ie x psi + d``. With ``k = g / R``, meridian radius R for north and transverse radius for
    east,

        ``x_N'' + 2 W sin(L) x_E' + k_N x_N =  g psi_E + b_N``
        ``x_E'' - 2 W sin(L) x_N' + k_E x_E = -g psi_N + b_E``.

    psi has terms in 1, t, cos(W t) and sin(W t). Each term drives one forced motion of x_N and x_E. Two free pendulum
    oscillations are added, so that initial position and velocity are zero.
    """
    t = np.asarray(time, dtype=float)
    lat = float(lat)
    g = float(gravity_n(lat, height)[2])
    radius = np.array(radii(lat)) + height
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

    def pull(vector: ComplexArray | FloatArray) -> ComplexArray:
        return np.array([g * vector[1], -g * vector[0]], dtype=complex)

    stiffness = np.diag(g / radius)
    turning = 2.0 * omega * np.sin(lat) * np.array([[0.0, 1.0], [-1.0, 0.0]])
    # forced part: steady + ramp t + the real part of daily exp(i W t)
    ramp = np.linalg.solve(stiffness, pull(slope))
    steady = np.linalg.solve(stiffness, pull(constant) + errors.bias[:2] - turning @ ramp)
    daily = np.linalg.solve(stiffness - omega**2 * np.eye(2) + 1j * omega * turning, pull(cosine - 1j * sine))
    forced = steady + ramp * t[:, None] + daily * np.exp(1j * phase)
    forced_rate = ramp + 1j * omega * daily * np.exp(1j * phase)
    # free oscillations, whose initial values cancel the forced part
    eigenvalue, eigenvector = np.linalg.eig(np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -turning]]))
    amplitude = np.linalg.solve(eigenvector, -np.concatenate([(steady + daily).real, (ramp + 1j * omega * daily).real]))
    swing = ((amplitude * np.exp(np.outer(t, eigenvalue))) @ eigenvector.T).real
    position, velocity = forced.real + swing[:, :2], forced_rate.real + swing[:, 2:]
    # position error as a rotation: dtheta = (dlon cos L, -dL, -dlon sin L)
    north, east = (position / radius).T
    tilt = psi + np.column_stack([east, -north, -east * np.tan(lat)])
    return StaticErrors(t, position, velocity, np.asarray(tilt))


def measured_periods(time: FloatArray, position: FloatArray, lat: float, height: float) -> Periods:
    """Measure periods in a record of position errors at rest, by least squares.

    `time` (n,): since the start [s]. `position` (n, 2): error North, East [m]. `lat`, `height`: latitude [rad] and
    height [m] for the initial guess.
    Raises: InputError: the record is shorter than half a day.

    Notes
    -----
    The fit of ``x_N + i x_E`` has a constant, a ramp and six circular motions: four of the pendulum and two at the
    Earth's rate. The fit estimates the three rates within a tenth of the expected ones, and all amplitudes, so that it
    is independent of the closed form. An accelerometer bias alone causes no motion at the Earth's rate (None).
    """
    if time[-1] - time[0] < SHORTEST_RECORD * 86400.0:
        raise InputError(
            "platform.record_too_short", duration_h=(time[-1] - time[0]) / 3600.0, limit_h=24.0 * SHORTEST_RECORD
        )
    t, z = time - time[0], position[:, 0] + 1j * position[:, 1]
    start = np.array([*_pendulum(lat, height), OMEGA_EARTH])

    def fitted(scale: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        rate, swing, earth = scale * start
        fast, slow = rate + swing, rate - swing
        waves = np.exp(1j * np.outer(t, [fast, slow, -fast, -slow, earth, -earth]))
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
    daily = max(size[6:]) > FAINT * max(size[2:])
    return Periods(2.0 * np.pi / swing, 2.0 * np.pi / rate, 2.0 * np.pi / earth if daily else None)


def _pendulum(lat: float, height: float) -> tuple[float, float]:
    """Compute the rotation rate of the oscillation plane, and the oscillation rate in that plane [rad/s]."""
    rate = OMEGA_EARTH * float(np.sin(lat))
    north, east = np.sqrt(gravity_n(lat, height)[2] / (np.array(radii(lat)) + height))
    turning = np.sqrt(rate**2 + 0.25 * (north - east) ** 2)
    return float(np.copysign(turning, rate)), float(np.sqrt(rate**2 + 0.25 * (north + east) ** 2))


@dataclass(frozen=True, slots=True)
class Convergence:
    """Largest error of an integrator for several step sizes."""

    integrator: Integrator
    step: FloatArray  # (n,) step sizes, in the unit of the independent variable
    error: FloatArray  # (n,) largest error with each step size

    @property
    def order(self) -> float:
        """Slope of log error over log step."""
        return float(np.polyfit(np.log(self.step), np.log(self.error), 1)[0])


@dataclass(frozen=True, slots=True)
class PlatformComparison:
    """Platform and strapdown navigator with equal errors on the same motion."""

    time: FloatArray  # (n,) times [s]
    platform: FloatArray  # (n, 3) position error North, East, Down of the height-constrained platform [m]
    strapdown: FloatArray  # (n, 3) position error of the height-constrained strapdown navigator [m]


@dataclass(frozen=True, slots=True)
class Demonstration:
    """Errors of integrators on a sine and a flight, and of platform and strapdown navigator at rest and in circles."""

    orders: Sequence[Convergence]
    flight: Mapping[float, Sequence[TrajectoryErrors]]  # errors by sampling rate [Hz], in the order of `INTEGRATORS`
    rest: PlatformComparison
    turning: PlatformComparison


@dataclass(frozen=True, slots=True)
class PlatformStudy:
    """Record of specific force, integrated by all integrators."""

    chosen: Integrator  # integrator of the main solution
    runs: Mapping[Integrator, PlatformRun]  # runs with the errors of the platform, by integrator
    errors: PlatformErrors
    reference: Trajectory | None  # reference for the comparison of integrators

    @property
    def run(self) -> PlatformRun:
        """Run of the chosen integrator."""
        return self.runs[self.chosen]

    @property
    def theory(self) -> StaticErrors | None:
        """Closed form of the errors, for a vehicle at rest with the vertical channel off."""
        run = self.run
        still = float(np.abs(run.undisturbed.v_n).max()) < REST_M_S
        if not self.errors.any or run.vertical != "off" or not still:
            return None
        start = run.undisturbed.lla[0]
        return static_errors(run.solution.time - run.solution.time[0], start[0], start[2], self.errors)

    def differences(self) -> dict[Integrator, TrajectoryErrors]:
        """Compare error-free runs with the reference; without it, compare solutions with the fourth-order one."""
        if self.reference is not None:
            return {name: position_errors(run.undisturbed, self.reference) for name, run in self.runs.items()}
        fourth = self.runs[AGAINST].solution
        return {name: position_errors(run.solution, fourth) for name, run in self.runs.items() if name != AGAINST}


def demonstrate() -> Demonstration:
    """Integrate a sine, a holding pattern and a day at rest, with known truth."""
    holding = partial(circle, np.array([LAT, 0.0, HEIGHT]), SPEED, 2.0 * np.pi / ROUND)
    at_rest = straight(np.array([LAT, 0.0, 0.0]), 0.0, 0.0, DAY)
    return Demonstration(
        sine_convergence(),
        integrator_errors(holding(FLIGHT), FLIGHT_RATES, keep=1.0),
        compare_with_strapdown(at_rest, ERRORS, DAY_RATE, 60.0),
        compare_with_strapdown(holding(PATTERN), ERRORS, PATTERN_RATE, 10.0),
    )


def sine_convergence() -> list[Convergence]:
    """Compute each integrator's largest error of the integral of sin(t) from 0 to 5; truth is 1 - cos(t)."""
    convergences = []
    for name in INTEGRATORS:
        errors = []
        for count in SINE_STEPS:
            t = np.linspace(0.0, SINE_END, count + 1)
            errors.append(float(np.abs(integral(t, np.sin(t), name) - (1.0 - np.cos(t))).max()))
        convergences.append(Convergence(name, SINE_END / np.array(SINE_STEPS), np.array(errors)))
    return convergences


def level_force(truth: Truth, time: FloatArray) -> FloatArray:
    """Compute specific force along North, East, Down, as measured by an error-free platform.

    `time` (n,): times [s].
    Returns: (n, 3): ``C_nb f_b`` [m/s^2].
    """
    at = truth.evaluate(time)
    return np.asarray((dcm_from_rph(at.rph) @ at.f_b[:, :, None])[:, :, 0])


def integrator_errors(
    truth: Truth, rates: Sequence[float], *, keep: float = 1.0
) -> dict[float, list[TrajectoryErrors]]:
    """Compute errors of each integrator on a level motion, for several sampling rates.

    `truth`: a motion at constant height, without vertical channel. `rates`: samples per second [Hz]. `keep`: interval
    of the returned errors [s], at least the sample interval.
    """
    errors = {}
    for rate in rates:
        time = truth.start + np.arange(round(truth.duration * rate) + 1) / rate
        force, start = level_force(truth, time), truth.evaluate(time[:1])
        every = max(1, round(keep * rate))
        actual = reference(truth, time[::every])
        runs = (
            navigate_platform(time, force, start.lla[0], start.v_n[0], integrator=name, every=every)
            for name in INTEGRATORS
        )
        errors[rate] = [position_errors(run.solution, actual) for run in runs]
    return errors


def compare_with_strapdown(truth: Truth, errors: PlatformErrors, rate: float, keep: float) -> PlatformComparison:
    """Apply equal errors to a platform and a strapdown navigator on the same motion.

    `truth`: a motion at constant height that begins level and northward. Forward, right, down are then the platform's
    axes, and strapdown and platform sensors sense almost the same. `errors`: platform drift d becomes a strapdown gyro
    bias of -d, which also rotates the computed axes by d. `rate`: samples per second [Hz]. `keep`: interval of the
    returned errors [s].
    """
    time = truth.start + np.arange(round(truth.duration * rate) + 1) / rate
    every = max(1, round(keep * rate))
    actual = reference(truth, time[::every])
    run = navigate_platform(
        time, level_force(truth, time), actual.lla[0], actual.v_n[0], integrator="fourth", errors=errors, every=every
    )
    imu = imu_from_truth(truth, time, "instant")
    imu.gyro[:] -= errors.drift
    imu.accel[:] += errors.bias
    inc = strapdown.increments(strapdown.intervals(imu)).rows(slice(1, None))
    fixed = np.full(len(inc.time), actual.lla[0, 2]), np.zeros(len(inc.time))
    start = rph_from_quat(quat_multiply(quat_from_rotvec(-errors.tilt), quat_from_rph(actual.rph[0])))
    solution = strapdown.navigate(inc, actual.lla[0], actual.v_n[0], start, vertical=fixed, every=every)
    difference = np.concatenate([np.zeros((1, 3)), ned_offset(solution.lla, actual.lla[1:])])
    return PlatformComparison(actual.time, ned_offset(run.solution.lla, actual.lla), difference)
