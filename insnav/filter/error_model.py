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

# Misalignment is not a state: most of its effect appears as scale factor or bias. The remainder makes errors in
# proportion to rate and acceleration. As noise, their spectral density is their square times the manoeuvre length [s].
MANOEUVRE = 1.0


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """Noise of the error-state filter."""

    # (20,) spectral densities. 3 axes each: white noise of gyros [rad^2/s] and accelerometers [m^2/s^3]. Driving noise
    # of gyro bias, accelerometer bias, gyro and accelerometer scale factor. Then misalignment (2), see `MANOEUVRE`
    noise: FloatArray
    decay: FloatArray  # (12,) inverse correlation time of the twelve sensor errors [1/s]
    sd: FloatArray  # (12,) initial standard deviation of each sensor error
    # (3,) sd of roll, pitch and heading of the IMU relative to its sensors [rad]. The filter estimates the attitude of
    # the sensors: roll and pitch of the accelerometers, heading of the gyros. Misalignment is not a state
    axes_sd: FloatArray = field(default_factory=lambda: np.zeros(3))

    @property
    def states(self) -> int:
        """Number of states: 21, or 15 with scale factor errors that are known to be zero."""
        return STATES if self.sd[6:].any() else STATES - 6


@dataclass(frozen=True, slots=True)
class InitialState:
    """Initial state and covariance."""

    time: float  # time of the state [s]
    # (3,) latitude, longitude [rad], height [m]. Velocity N, E, D [m/s]. Roll, pitch, heading [rad], at the IMU
    lla: FloatArray
    v_n: FloatArray
    rph: FloatArray
    gyro_bias: FloatArray  # (3,) first estimate of the gyro bias [rad/s]
    covariance: FloatArray  # (21, 21) of the error states; see `insnav.kernels.errorstate`
    own: FloatArray  # (3,) variance of the attitude, without the part caused by sensor errors
    from_fix: bool = False  # true if the position was set to a fix and has the error of the fix


@dataclass(frozen=True, slots=True)
class Part:
    """Start of the filter, or restart after a long gap of the samples."""

    after: float  # last sample before the gap, or first sample of the record [s]
    alignment: Alignment
    initial: InitialState


@dataclass(frozen=True, slots=True)
class FilterState:
    """Complete state of the filter at one time."""

    time: float  # time of the state [s]
    x: FloatArray  # (10,) position, velocity, quaternion; see `insnav.kernels.mechanization`
    correction: FloatArray  # (12,) estimated sensor errors; see `insnav.kernels.errorstate`
    lever_b: FloatArray  # (3,) antenna seen from the IMU, body axes [m]
    further: FloatArray  # values of the other state blocks, in their order
    motion: FloatArray  # (6,) body rate [rad/s] and acceleration in n [m/s^2]
    covariance: FloatArray  # (n, n) covariance of the error states

    def replace_further(self, place: int | slice, value: float) -> FilterState:
        """Copy with a new value at an index of `insnav.kernels.measurements` from `FURTHER` on, such as `DELAY`."""
        estimated = np.concatenate([np.zeros(FURTHER), self.further])
        estimated[place] = value
        return replace(self, further=estimated[FURTHER:])


def _bias(sensor: SensorSpec, turn_on: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Combine turn-on and in-run bias into one state: noise density, inverse correlation time, sd.

    The in-run bias is a Gauss-Markov process with driving noise ``2 sd^2 / T``. The combined state has this noise, but
    the stationary variance of both biases. Its correlation time is longer: a turn-on bias does not fade within `T`.
    """
    in_run = noise_of(sensor, "Gauss-Markov")
    sd = np.hypot(turn_on, in_run)
    driving = 2.0 * in_run**2 / sensor.correlation_time
    decay = np.where(sd > 0, driving / (2.0 * np.where(sd > 0, sd, 1.0) ** 2), 0.0)
    return driving + noise_of(sensor, "random walk") ** 2, decay, sd


def _scale(sensor: SensorSpec) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Model scale factor errors as Gauss-Markov processes with the bias's correlation time: temperature drives both."""
    decay = np.full(3, 1.0 / sensor.correlation_time)
    return 2.0 * sensor.scale_factor**2 * decay, decay, sensor.scale_factor


def error_model(spec: ImuSpec, states: int) -> ErrorModel:
    """Build the noise model of the filter for an IMU with Gauss-Markov sensor errors (Groves 2013, section 14.2.6).

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
    misaligned = [MANOEUVRE * float(np.mean(sensor.misalignment**2)) for sensor in (spec.gyro, spec.accel)]
    axes_sd = np.array([*spec.accel.misalignment[[1, 0]], spec.gyro.misalignment[2]])
    return ErrorModel(np.concatenate([white, driving, misaligned]), decay, sd, axes_sd)


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
    """Build the initial state and its covariance from an alignment, a position and a velocity, with sds [m], [m/s].

    Levelling turns an accelerometer bias into a tilt error, and gyrocompassing turns a gyro bias into a heading error.
    The covariance contains these correlations. The gyro bias is the weighted mean of zero (specification) and the
    estimate of the alignment. `own` (3,): attitude variance without the part caused by sensor errors. By default it
    follows from the alignment.
    """
    sd = model.sd.copy()
    weight = 1.0 / (1.0 + (alignment.gyro_bias_sd / np.maximum(sd[:3], 1e-15)) ** 2)  # weight of the alignment
    sd[:3] *= np.sqrt(1.0 - weight)
    p = np.zeros((STATES, STATES))
    p[:9, :9] = np.diag(np.concatenate([position_sd, velocity_sd, alignment.sd]) ** 2)
    p[9:, 9:] = np.diag(sd**2)
    c = dcm_from_rph(alignment.rph)
    j = np.zeros((3, 12))  # derivative of attitude errors by sensor errors
    if alignment.level_method is Code.ALIGN_LEVEL_STATIC:
        # levelling assumes no horizontal specific force: f x phi = C d(bias)
        g = float(gravity_n(lla[0], lla[2])[2])
        j[0, 3:6], j[1, 3:6] = -c[1] / g, c[0] / g
    if alignment.heading_method is Code.ALIGN_HEADING_GYROCOMPASS:
        # gyrocompassing assumes no east component of Earth rotation: w_ie_N phi_D = -(C d bias)_E
        j[2, 0:3] = -c[1] / (OMEGA_EARTH * np.cos(lla[0]))
        j[2, 3:6] = -np.tan(lla[0]) * j[0, 3:6]
    shared = j @ p[9:, 9:] @ j.T
    total = alignment.sd**2 if own is None else own + np.diag(shared)
    own = np.maximum(total - np.diag(shared), 1e-4 * total)
    p[6:9, 6:9] = shared + np.diag(own)
    p[6:9, 9:] = j @ p[9:, 9:]
    p[9:, 6:9] = p[6:9, 9:].T
    return InitialState(alignment.time, lla, v_n, alignment.rph, weight * alignment.gyro_bias, p, own, from_fix)


@dataclass(frozen=True, slots=True)
class StateBlock:
    """Group of states after the 21 basic ones of `insnav.kernels.errorstate`, or known values instead of states.

    The derivatives of a fix by these states are in `insnav.kernels.measurements.assess`.
    """

    name: str
    value: FloatArray  # (k,) initial values, or known values
    sd: FloatArray  # (k,) initial sd; empty for known values
    time: FloatArray = field(default_factory=lambda: np.empty(0))  # (k,) correlation times [s]; empty if constant


def blocks_of(receiver: Receiver) -> tuple[StateBlock, ...]:
    """List the state blocks for a receiver, in the order of `insnav.kernels.measurements.DELAYED` to `LAGGED`.

    If any later block has states, the delay is a state, too, if only a known zero.
    """
    arm, noise = receiver.lever_arm, receiver.correlated
    swings = arm.shaken > 0.0 and (arm.sd > 0.0 or arm.value.any())
    correlated = () if noise is None else (noise.sds, noise.times)
    after = (
        # time-correlated errors of positions, and of velocities if modelled
        StateBlock("correlated", np.zeros(6), *(correlated or (np.empty(0),))),
        StateBlock("lever", arm.value, _sd_of(arm.sd, 3)),
        # arm for rotation by vibration: a receiver averages over 20 to 200 ms, and vibration need not move the antenna
        StateBlock("shaken", arm.value, _sd_of(arm.shaken * swings, 3)),
        StateBlock("lag", np.full(1, receiver.lag.value), _sd_of(receiver.lag.sd, 1)),
    )
    needed = receiver.delay.sd > 0.0 or any(block.sd.size for block in after)
    return StateBlock("delay", np.zeros(1), np.full(1, receiver.delay.sd)[: int(needed)]), *after


def _sd_of(sd: float, size: int) -> FloatArray:
    return np.full(size if sd > 0.0 else 0, sd)


class Layout(NamedTuple):
    """Arrangement of the states: number, blocks, and index of the first state of some blocks (-1 if known)."""

    states: int
    blocks: tuple[StateBlock, ...]
    places: IntArray  # (k, 3) table of the blocks; see `insnav.kernels.measurements.DELAYED`
    delay: int
    correlated: int
    lever: int
    shaken: int
    lag: int

    @property
    def has_arm(self) -> bool:
        """Test whether a lever arm is estimated."""
        return self.lever >= 0 or self.shaken >= 0


def layout(receiver: Receiver) -> Layout:
    """Arrange the states for a receiver: assign an index to the first state of each block."""
    blocks, first, place, places = blocks_of(receiver), STATES, FURTHER, dict[str, tuple[int, int, int]]()
    for block in blocks:
        listed, size = block.name != "lever", block.sd.size  # the lever arm is stored in `ARM`, see `correct_with_arm`
        places[block.name] = first if size else -1, place if listed else ARM.start, size
        first, place = first + size, place + listed * block.value.size
    named = {name: places[name][0] for name in Layout._fields[3:]}
    return Layout(first, blocks, np.array([*places.values()]), **named)


def first_state(start: InitialState, receiver: Receiver) -> FilterState:
    """Build the initial values and the covariance of all states for a receiver."""
    index = layout(receiver)
    covariance = np.zeros((index.states, index.states))
    covariance[:STATES, :STATES] = start.covariance
    sd = np.concatenate([block.sd for block in index.blocks])
    covariance[STATES:, STATES:] = np.diag(sd**2)
    if index.shaken >= 0 and index.lever >= 0:
        mapping = np.eye(index.states)
        mapping[index.shaken : index.shaken + 3, index.lever : index.lever + 3] = np.eye(3)
        covariance = mapping @ covariance @ mapping.T
    if start.from_fix and index.delay >= 0:
        if receiver.correlated is not None:
            cross_covariance(covariance, index.correlated, receiver.correlated.sd)
        mapping = set_to_fix(index, start.v_n, dcm_from_rph(start.rph))
        covariance = mapping @ covariance @ mapping.T
    x = np.concatenate([start.lla, start.v_n, quat_from_rph(start.rph)])
    correction = np.concatenate([start.gyro_bias, np.zeros(9)])
    further = np.concatenate([block.value for block in index.blocks if block.name != "lever"])
    return FilterState(start.time, x, correction, receiver.lever_arm.value.copy(), further, np.zeros(6), covariance)


def set_to_fix(at: Layout, v_n: FloatArray, c: FloatArray) -> FloatArray:
    """Return the matrix (n, n) that adds delay and lever-arm errors to the error of a position that is set to a fix."""
    mapping = np.eye(at.states)
    if at.delay >= 0:
        mapping[:3, at.delay] = v_n
    if at.lever >= 0:
        mapping[:3, at.lever : at.lever + 3] = -c
    return mapping


def reset_correlated(covariance: FloatArray, at: int, sd: FloatArray) -> None:
    """Reset the time-correlated GPS error, from state `at` on, to its standard deviation and zero correlations."""
    part = slice(at, at + sd.size)
    covariance[part, :] = covariance[:, part] = 0.0
    covariance[part, part] = np.diag(sd**2)


def cross_covariance(covariance: FloatArray, at: int, sd: FloatArray) -> None:
    """Correlate a position, or position and velocity, that was set to a fix with the time-correlated error of the fix.

    The position error equals the error of the fix. The state of this error is estimated as zero, so its own error is
    the negative, and their covariance is ``-sd^2``. A slightly larger position variance keeps the matrix positive.
    """
    for i in range(sd.size):
        covariance[i, i] = max(covariance[i, i], 1.0001 * sd[i] ** 2)
        covariance[i, at + i] = covariance[at + i, i] = -(sd[i] ** 2)
