"""Simulated budget: free-inertial Monte Carlo runs of sampled IMUs on one motion.

Every run samples its constant errors with `insnav.imu.sample_errors`, its noise as `insnav.simulate.corrupt_imu` does.
The step that navigates recordings integrates it. The compiled loop neglects the effect of sensor errors on coning and
sculling, which is of second order.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from insnav.attitude import quat_conjugate, quat_from_rotvec, quat_from_rph, quat_multiply, rotvec_from_quat
from insnav.earth import lla_offset, ned_offset
from insnav.engine import Workers, every
from insnav.errors.budget.sources import STATES, SampledMotion, Source
from insnav.imu import ErrorTerms, ImuErrors, ImuSpec, InitialSpec, SensorSpec, sample_errors
from insnav.imu.error_terms import SENSORS, TERMS, Process
from insnav.imu.model import SAMPLED
from insnav.imu.specification import noise_of, noise_of_both
from insnav.kernels import error_propagation as _kernel
from insnav.simulate.imu_errors import flicker, further_errors
from insnav.types import FloatArray, IntArray
from insnav.units import G0

_NO_TERMS = ErrorTerms()
_BLOCK = 500  # runs per process call; more runs start processes
# noise in the compiled kernel; other noise is added to the samples before
_IN_KERNEL: tuple[Process, ...] = ("white", "Gauss-Markov", "random walk")


def free_runs(
    spec: ImuSpec,
    motion: SampledMotion,
    rows: IntArray,
    runs: int,
    seed: int | tuple[int, ...],
    *,
    deflection: float = 0.0,
    hold: bool = False,
    known: tuple[Source, ...] = (),
    workers: Workers = 1,
    progress: Callable[[float], None] | None = None,
) -> FloatArray:
    """Navigate without aiding, many times, each time with another IMU and another start.

    `rows` (m,): samples after which errors are returned, increasing. `seed`: determines the runs; their number does not
    change the first runs. `deflection`: deflection of the vertical [rad]; see
    `insnav.errors.budget.sources.sources_of`. `known`: correlated errors of start and sensors in addition to `spec`;
    see `start_sources`.
    Returns: (runs, m, 9) errors of position N, E, D [m], velocity [m/s], attitude [rad], estimate minus truth. Attitude
    error: ``C_hat = (I - [phi x]) C``.
    """
    blocks = [range(first, min(first + _BLOCK, runs)) for first in range(0, runs, _BLOCK)]
    shared = (spec, motion, rows, seed, deflection, hold, known)
    return _errors(np.concatenate(list(every(_states, blocks, workers, shared, progress))), motion, rows)


def _states(
    spec: ImuSpec,
    motion: SampledMotion,
    rows: IntArray,
    seed: int | tuple[int, ...],
    deflection: float,
    hold: bool,
    known: tuple[Source, ...],
    numbers: range,
) -> FloatArray:
    """Compute the states of some runs after the samples `rows`, (runs, m, 10)."""
    truth, inc, n = motion.truth, motion.increments, int(rows[-1])
    height, v_down = truth.lla[1 : n + 1, 2].copy(), truth.v_n[1 : n + 1, 2].copy()
    states = np.empty((len(numbers), len(rows), 10))
    base = (motion.rate[:n], motion.force[:n], inc.coning[:n], inc.sculling[:n])
    carried = np.array([source.sd * np.array(source.joint) for source in known]).reshape(len(known), STATES)
    dt, changes = motion.dt[:n], _changes(motion, n) if spec.clock.offset or spec.clock.drift else None
    some = changes is not None or any(
        np.any(getattr(getattr(spec, term.sensor), term.key))
        for term in TERMS
        if term.in_budget and term.key not in SAMPLED and term.process not in _IN_KERNEL
    )
    more = np.zeros((0, 6))
    white, drift, walk = (noise_of_both(spec, process) for process in _IN_KERNEL)
    decay = 1.0 / np.array([spec.gyro.correlation_time, spec.accel.correlation_time])
    rngs = [np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(run,))) for run in numbers]
    sampled, together, drawn = [], np.zeros((len(rngs), STATES)), np.empty((len(rngs), 9))
    for place, rng in enumerate(rngs):
        sampled.append(_of_errors(sample_errors(spec, rng)))
        if known:
            together[place] = rng.standard_normal(len(known)) @ carried
        drawn[place] = rng.standard_normal(9)
    starts = _starts(spec.initial or InitialSpec(), motion, drawn, hold, together[:, :9])
    for place, rng in enumerate(rngs):
        taken_off = together[place, 9:].reshape(4, 3)
        sampled[place][0][:] -= taken_off[:2].ravel()
        sampled[place][1][:, range(3), range(3)] -= taken_off[2:]
        if some:
            more = _more(spec, motion, n, rng, changes)
        gravity = -deflection * G0 * rng.standard_normal(3)
        _kernel.corrupted_run(
            rng,
            starts[place],
            dt,
            *base,
            more,
            *sampled[place],
            white,
            drift,
            decay,
            walk,
            gravity,
            hold,
            height,
            v_down,
            rows,
            states[place],
        )
    return states


def _of_errors(errors: ImuErrors) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Convert bias, matrices, bends and g-sensitivity for the kernel."""
    terms = [errors.gyro_terms or _NO_TERMS, errors.accel_terms or _NO_TERMS]
    return (
        np.concatenate([errors.gyro_bias, errors.accel_bias]),
        np.array([errors.gyro_matrix, errors.accel_matrix]),
        np.array([[each.asymmetry, each.quadratic] for each in terms]),
        np.asarray(terms[0].g_sensitivity),
    )


def _starts(
    initial: InitialSpec, motion: SampledMotion, drawn: FloatArray, hold: bool, together: FloatArray
) -> FloatArray:
    """Build initial states (runs, 10) from normal numbers and correlated errors, both (runs, 9)."""
    sd = np.array([*3 * [initial.position], *3 * [initial.velocity], initial.tilt, initial.tilt, initial.heading])
    error = drawn * sd + together
    if hold:
        error[:, [2, 5]] = 0.0
    q_hat = quat_multiply(quat_from_rotvec(-error[:, 6:]), quat_from_rph(motion.truth.rph[0]))
    return np.hstack([lla_offset(motion.truth.lla[0], error[:, :3]), motion.truth.v_n[0] + error[:, 3:6], q_hat])


def _changes(motion: SampledMotion, n: int) -> FloatArray:
    """Compute the change rate of the true samples, ``(n, 6)``: times a clock delay, it is the delay's effect."""
    middle = motion.elapsed - 0.5 * motion.dt
    return np.asarray(np.gradient(np.concatenate([motion.rate, motion.force], axis=1), middle, axis=0)[:n])


def _more(
    spec: ImuSpec, motion: SampledMotion, n: int, rng: np.random.Generator, changes: FloatArray | None
) -> FloatArray:
    """Sample the errors outside the kernel, ``(n, 6)``."""
    elapsed = motion.elapsed[:n]
    made = np.zeros((n, 6))
    since = (elapsed - elapsed[0])[:, None]
    for part, name in enumerate(SENSORS):
        sensor: SensorSpec = getattr(spec, name)
        own = made[:, 3 * part : 3 * part + 3]
        own += further_errors(name, sensor, motion.rate[:n], motion.force[:n], since, rng)
        if np.any(quantisation := noise_of(sensor, "quantisation")):
            steps = rng.uniform(-1.0, 1.0, (n, 3)) * (math.sqrt(3.0) * quantisation)
            own += np.diff(steps, axis=0, prepend=np.zeros((1, 3))) / motion.dt[:n, None]
        if np.any(size := noise_of(sensor, "flicker")):
            own += flicker(np.random.SeedSequence(int(rng.integers(2**53))), elapsed, size)
    if changes is not None:
        offset, drift = rng.standard_normal(2) * [spec.clock.offset, spec.clock.drift]
        made -= (offset + drift * elapsed)[:, None] * changes
    return made


def _errors(states: FloatArray, motion: SampledMotion, rows: IntArray) -> FloatArray:
    """Compute errors of states ``(runs, m, 10)`` against the truth, ``(runs, m, 9)``."""
    truth = motion.truth
    lla, v_n, rph = truth.lla[rows], truth.v_n[rows], truth.rph[rows]
    turn = quat_multiply(states[..., 6:], quat_conjugate(quat_from_rph(rph)))
    position = ned_offset(states[..., :3], np.broadcast_to(lla, (*states.shape[:2], 3)))
    return np.concatenate([position, states[..., 3:6] - v_n, -rotvec_from_quat(turn)], axis=-1)
