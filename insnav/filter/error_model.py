"""Noise and initial covariance of the filter from the IMU specification and an alignment; layout of its states."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from insnav.attitude import dcm_from_rph, quat_from_rph
from insnav.earth import OMEGA_EARTH, gravity_n
from insnav.filter.receiver import Receiver
from insnav.findings import Code
from insnav.imu.specification import ImuSpec, SensorSpec, level_bias, noise_of, noise_of_both
from insnav.kernels.errorstate import STATES
from insnav.kernels.measurements import ARM, FURTHER
from insnav.types import Alignment, FloatArray, IntArray

# Misalignment is not a state: most of it appears as scale factor or bias. The remainder makes angle and velocity errors
# proportional to rate and acceleration, as noise: their squares times the length of a manoeuvre [s].
MANOEUVRE = 1.0


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """Noise of the error-state filter."""

    # (20,) spectral densities: gyro [rad^2/s] and accelerometer [m^2/s^3] white noise, driving noise of gyro bias,
    # accelerometer bias, gyro and accelerometer scale factor. Then misalignment, see `MANOEUVRE`
    noise: FloatArray
    decay: FloatArray  # (12,) inverse correlation time of the twelve sensor errors [1/s]
    sd: FloatArray  # (12,) initial standard deviation of each sensor error
    # (3,) misalignment between the sensor axes, whose attitude the filter estimates, and the IMU [rad]: roll and pitch
    # of the accelerometers, heading of the gyros. It is not a state.
    axes_sd: FloatArray = field(default_factory=lambda: np.zeros(3))

    @property
    def states(self) -> int:
        """Number of states: 21, or 15 with scale factor errors that are known to be zero."""
        return STATES if self.sd[6:].any() else STATES - 6


@dataclass(frozen=True, slots=True)
class InitialState:
    """Initial state and covariance."""

    time: float  # [s]
    # (3,) latitude, longitude [rad], height [m]. Velocity N, E, D [m/s]. Roll, pitch, heading [rad], at the IMU
    lla: FloatArray
    v_n: FloatArray
    rph: FloatArray
    gyro_bias: FloatArray  # (3,) first estimate of the gyro bias [rad/s]
    covariance: FloatArray  # (21, 21) of the error states; see `insnav.kernels.errorstate`
    own: FloatArray  # (3,) variance of the attitude, without the share of sensor errors
    from_fix: bool = False  # the position comes from a fix and has its errors


@dataclass(frozen=True, slots=True)
class Part:
    """Point where the filter starts, or continues after a gap."""

    after: float  # time of the last sample before the gap, or of the first sample [s]
    alignment: Alignment
    initial: InitialState


@dataclass(frozen=True, slots=True)
class FilterState:
    """The whole state of the filter at one time."""

    time: float  # [s]
    x: FloatArray  # (10,) position, velocity, quaternion; see `insnav.kernels.mechanization`
    correction: FloatArray  # (12,) estimated sensor errors; see `insnav.kernels.errorstate`
    lever_b: FloatArray  # (3,) antenna seen from the IMU, body axes [m]
    further: FloatArray  # values of the other state blocks, in their order
    motion: FloatArray  # (6,) body rate [rad/s] and acceleration in n [m/s^2]
    covariance: FloatArray  # (n, n) of the error states

    def replace_further(self, place: int | slice, value: float) -> FilterState:
        """Copy with a new value at an index of `insnav.kernels.measurements` from `FURTHER` on, such as `DELAY`."""
        estimated = np.concatenate([np.zeros(FURTHER), self.further])
        estimated[place] = value
        return replace(self, further=estimated[FURTHER:])


def _bias(sensor: SensorSpec, turn_on: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Combine turn-on and in-run bias into one state: noise density, inverse correlation time, sd.

    The in-run Gauss-Markov process keeps its driving noise, ``2 sd^2 / T``. A longer correlation time gives the
    stationary variance of both together. A turn-on bias then does not fade within `T`.
    """
    in_run = noise_of(sensor, "Gauss-Markov")
    sd = np.hypot(turn_on, in_run)
    driving = 2.0 * in_run**2 / sensor.correlation_time
    decay = np.where(sd > 0, driving / (2.0 * np.where(sd > 0, sd, 1.0) ** 2), 0.0)
    return driving + noise_of(sensor, "random walk") ** 2, decay, sd


def _scale(sensor: SensorSpec) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Model scale factor error as a Gauss-Markov process with the bias's correlation time: temperature drives both."""
    decay = np.full(3, 1.0 / sensor.correlation_time)
    return 2.0 * sensor.scale_factor**2 * decay, decay, sensor.scale_factor


def error_model(spec: ImuSpec, states: int) -> ErrorModel:
    """Build the filter noise of an IMU with Gauss-Markov sensor errors (Groves 2013, section 14.2.6).

    With 15 `states`, scale factor errors are zero.
    """
    parts = [
        _bias(spec.gyro, spec.gyro.bias),
        _bias(spec.accel, level_bias(spec.accel)),
        _scale(spec.gyro),
        _scale(spec.accel),
    ]
    driving, decay, sd = (np.concatenate([p[i] for p in parts]) for i in range(3))
    if states == 15:
        driving[6:] = decay[6:] = sd[6:] = 0.0
    white = noise_of_both(spec, "white") ** 2
    askew = [MANOEUVRE * float(np.mean(sensor.misalignment**2)) for sensor in (spec.gyro, spec.accel)]
    axes_sd = np.array([*spec.accel.misalignment[[1, 0]], spec.gyro.misalignment[2]])
    return ErrorModel(np.concatenate([white, driving, askew]), decay, sd, axes_sd)


def initial_state(
    alignment: Alignment,
    model: ErrorModel,
    lla: FloatArray,
    v_n: FloatArray,
    position_sd: FloatArray,
    velocity_sd: FloatArray,
    *,
    own: FloatArray | None = None,
    from_fix: bool = False,
) -> InitialState:
    """Build state and covariance from an alignment, a position and a velocity, with sds [m], [m/s].

    Levelling compensates accelerometer bias by tilt, and gyrocompassing compensates gyro bias by heading: the sums are
    zero. The covariance contains these correlations. The gyro bias is the weighted mean of zero (specification) and the
    alignment's estimate. `own` (3,): variance of the attitude without the share of sensor errors, instead of the
    alignment's.
    """
    sd = model.sd.copy()
    seen = 1.0 / (1.0 + (alignment.gyro_bias_sd / np.maximum(sd[:3], 1e-15)) ** 2)  # weight of the alignment
    sd[:3] *= np.sqrt(1.0 - seen)
    p = np.zeros((STATES, STATES))
    p[:9, :9] = np.diag(np.concatenate([position_sd, velocity_sd, alignment.sd]) ** 2)
    p[9:, 9:] = np.diag(sd**2)
    c = dcm_from_rph(alignment.rph)
    j = np.zeros((3, 12))  # attitude error by sensor errors
    if alignment.level_method is Code.ALIGN_LEVEL_STATIC:
        # f x phi = C d(bias): the levelled specific force has no horizontal part
        g = float(gravity_n(lla[0], lla[2])[2])
        j[0, 3:6], j[1, 3:6] = -c[1] / g, c[0] / g
    if alignment.heading_method is Code.ALIGN_HEADING_GYROCOMPASS:
        # the levelled, turned rate has no east part: w_ie_N phi_D = -(C d bias)_E for rate = measured - bias
        j[2, 0:3] = -c[1] / (OMEGA_EARTH * np.cos(lla[0]))
        j[2, 3:6] = -np.tan(lla[0]) * j[0, 3:6]
    shared = j @ p[9:, 9:] @ j.T
    whole = alignment.sd**2 if own is None else own + np.diag(shared)
    own = np.maximum(whole - np.diag(shared), 1e-4 * whole)
    p[6:9, 6:9] = shared + np.diag(own)
    p[6:9, 9:] = j @ p[9:, 9:]
    p[9:, 6:9] = p[6:9, 9:].T
    return InitialState(alignment.time, lla, v_n, alignment.rph, seen * alignment.gyro_bias, p, own, from_fix)


@dataclass(frozen=True, slots=True)
class StateBlock:
    """Group of states that follow `insnav.kernels.errorstate`, or known values in their place.

    The derivatives of a fix by these states are in `insnav.kernels.measurements.assess`.
    """

    name: str
    value: FloatArray  # (k,) at the start
    sd: FloatArray  # (k,) of its error at the start; empty for known values
    time: FloatArray = field(default_factory=lambda: np.empty(0))  # (k,) correlation times [s]; empty if constant


def blocks_of(receiver: Receiver) -> tuple[StateBlock, ...]:
    """List the state blocks for a receiver, in the order of `insnav.kernels.measurements.DELAYED` to `LAGGED`.

    States after the delay need its place, if only as a known zero.
    """
    arm, noise = receiver.lever_arm, receiver.correlated
    swings = arm.shaken > 0.0 and (arm.sd > 0.0 or arm.value.any())
    correlated = () if noise is None else (noise.sds, noise.times)
    after = (
        # time-correlated errors of positions, and of velocities if modelled
        StateBlock("correlated", np.zeros(6), *(correlated or (np.empty(0),))),
        StateBlock("lever", arm.value, _sd_of(arm.sd, 3)),
        # A receiver measures velocity over its own 20 to 200 ms, and vibration of the IMU need not move the antenna.
        # In addition to the lever arm.
        StateBlock("shaken", arm.value, _sd_of(arm.shaken * swings, 3)),
        StateBlock("lag", np.full(1, receiver.lag.value), _sd_of(receiver.lag.sd, 1)),
    )
    needed = receiver.delay.sd > 0.0 or any(block.sd.size for block in after)
    return StateBlock("delay", np.zeros(1), np.full(1, receiver.delay.sd)[: int(needed)]), *after


def _sd_of(sd: float, size: int) -> FloatArray:
    return np.full(size if sd > 0.0 else 0, sd)


class Layout(NamedTuple):
    """Number of states, their blocks, and the first index of some blocks; -1 if their values are known."""

    states: int
    blocks: tuple[StateBlock, ...]
    places: IntArray  # (k, 3) of the blocks; see `insnav.kernels.measurements.DELAYED`
    delay: int
    correlated: int
    lever: int
    shaken: int
    lag: int

    @property
    def has_arm(self) -> bool:
        """Return whether turns determine an estimated lever arm."""
        return self.lever >= 0 or self.shaken >= 0


def layout(receiver: Receiver) -> Layout:
    """Lay out the states for a receiver."""
    blocks, first, place, places = blocks_of(receiver), STATES, FURTHER, dict[str, tuple[int, int, int]]()
    for block in blocks:
        own, size = block.name != "lever", block.sd.size  # the arm has its own place, see `correct_with_arm`
        places[block.name] = first if size else -1, place if own else ARM.start, size
        first, place = first + size, place + own * block.value.size
    named = {name: places[name][0] for name in Layout._fields[3:]}
    return Layout(first, blocks, np.array([*places.values()]), **named)


def first_state(start: InitialState, receiver: Receiver) -> FilterState:
    """Build the initial state and covariance of all states for a receiver."""
    at = layout(receiver)
    covariance = np.zeros((at.states, at.states))
    covariance[:STATES, :STATES] = start.covariance
    own = np.concatenate([block.sd for block in at.blocks])
    covariance[STATES:, STATES:] = np.diag(own**2)
    if at.shaken >= 0 and at.lever >= 0:
        by = np.eye(at.states)
        by[at.shaken : at.shaken + 3, at.lever : at.lever + 3] = np.eye(3)
        covariance = by @ covariance @ by.T
    if start.from_fix and at.delay >= 0:
        if receiver.correlated is not None:
            cross_covariance(covariance, at.correlated, receiver.correlated.sd)
        by = set_to_fix(at, start.v_n, dcm_from_rph(start.rph))
        covariance = by @ covariance @ by.T
    x = np.concatenate([start.lla, start.v_n, quat_from_rph(start.rph)])
    correction = np.concatenate([start.gyro_bias, np.zeros(9)])
    further = np.concatenate([block.value for block in at.blocks if block.name != "lever"])
    return FilterState(start.time, x, correction, receiver.lever_arm.value.copy(), further, np.zeros(6), covariance)


def set_to_fix(at: Layout, v_n: FloatArray, c: FloatArray) -> FloatArray:
    """Return the error mapping (n, n) of setting a position to a fix, at a velocity (3,) [m/s] and ``C_nb`` (3, 3)."""
    by = np.eye(at.states)
    if at.delay >= 0:
        by[:3, at.delay] = v_n
    if at.lever >= 0:
        by[:3, at.lever : at.lever + 3] = -c
    return by


def reset_correlated(covariance: FloatArray, at: int, sd: FloatArray) -> None:
    """Reset the time-correlated GPS error to its own standard deviation."""
    part = slice(at, at + sd.size)
    covariance[part, :] = covariance[:, part] = 0.0
    covariance[part, part] = np.diag(sd**2)


def cross_covariance(covariance: FloatArray, at: int, sd: FloatArray) -> None:
    """Correlate a position, or position and velocity, that was set to a fix with the fix's time-correlated error.

    The position error equals the error of the fix, and the state compensates it: their covariance is ``-sd^2``. The
    position variance is slightly larger, so that the matrix stays positive.
    """
    for i in range(sd.size):
        covariance[i, i] = max(covariance[i, i], 1.0001 * sd[i] ** 2)
        covariance[i, at + i] = covariance[at + i, i] = -(sd[i] ** 2)
