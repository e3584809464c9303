"""Error budget: analytic, predicted, simulated and recorded errors at the same times.

The simulated budget has free-inertial Monte Carlo runs of sampled IMUs on one motion. Every run samples its constant
errors with `insnav.imu.sample_errors`, and its noise like `insnav.simulate.corrupt_imu`. The compiled loop has
the mechanization step for recorded data. It neglects second-order effects of sensor errors on coning and sculling.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from insnav.attitude import quat_conjugate, quat_from_rotvec, quat_from_rph, quat_multiply, rotvec_from_quat
from insnav.earth import lla_offset, ned_offset
from insnav.engine import Workers, every, share_of
from insnav.errors.budget import predicted
from insnav.errors.budget.predicted import analytic, covariance, schuler_rate
from insnav.errors.budget.sources import STATES, SampledMotion, Source, families, left_out, not_given, only, sources_of
from insnav.exceptions import ConfigError
from insnav.imu import ErrorTerms, ImuErrors, ImuSpec, InitialSpec, SensorSpec, sample_errors
from insnav.imu.model import SAMPLED
from insnav.imu.specification import SENSORS, TERMS, Process, noise_of, noise_of_both
from insnav.kernels import error_propagation as _kernel
from insnav.sample_statistics import chi_square
from insnav.simulate.sensor_errors import flicker, further_errors
from insnav.types import FloatArray, IntArray
from insnav.units import DEG, G0

_NO_TERMS = ErrorTerms()
_BLOCK = 500  # runs per task; a larger number of runs is shared among processes
# noise that the compiled kernel samples; other noise is sampled before and passed to the kernel
_IN_KERNEL: tuple[Process, ...] = ("white", "Gauss-Markov", "random walk")
BAND = 0.95  # probability of a band [-]
LINEAR = 5.0 * DEG  # largest attitude error for which the linear model is valid [rad]
SHORTEST, LONGEST = 0.1, 3600.0  # time range of a budget [s]
_CURVE = 60  # approximate number of points of a curve
_AT_START = re.compile(r"initial\.|.*\.(bias|scale_factor)$")  # keys of errors that a known start covariance replaces
_ALONE = 200  # limit of the runs with one family alone, whose RMS is then accurate to 5 %


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
    """Simulate many free-inertial runs on one motion, each with its own sampled IMU and start errors.

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
    """Simulate the runs `numbers`; return their states after the samples `rows`, (runs, m, 10)."""
    truth, inc, n = motion.truth, motion.increments, int(rows[-1])
    vertical = (hold, truth.lla[1 : n + 1, 2].copy(), truth.v_n[1 : n + 1, 2].copy())
    states = np.empty((len(numbers), len(rows), 10))
    base = (motion.dt[:n], motion.rate[:n], motion.force[:n], inc.coning[:n], inc.sculling[:n])
    joint = np.array([source.sd * np.array(source.joint) for source in known]).reshape(len(known), STATES)
    changes = None  # (n, 6) rates of change of the true samples; a clock delay adds minus delay times rate
    if spec.clock.offset or spec.clock.drift:
        samples, middle = np.concatenate([motion.rate, motion.force], axis=1), motion.elapsed - 0.5 * motion.dt
        changes = np.asarray(np.gradient(samples, middle, axis=0)[:n])
    # IMU errors that the kernel does not sample
    more_errors = changes is not None or any(
        np.any(getattr(getattr(spec, term.sensor), term.key))
        for term in TERMS
        if term.in_budget and term.key not in SAMPLED and term.process not in _IN_KERNEL
    )
    more = np.zeros((0, 6))
    white, drift, walk = (noise_of_both(spec, process) for process in _IN_KERNEL)
    noise = (white, drift, 1.0 / np.array([spec.gyro.correlation_time, spec.accel.correlation_time]), walk)
    rngs = [np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(run,))) for run in numbers]
    sampled, correlated, drawn = [], np.zeros((len(rngs), STATES)), np.empty((len(rngs), 9))
    for index, rng in enumerate(rngs):
        sampled.append(_of_errors(sample_errors(spec, rng)))
        if known:
            correlated[index] = rng.standard_normal(len(known)) @ joint
        drawn[index] = rng.standard_normal(9)
    starts = _starts(spec.initial or InitialSpec(), motion, drawn, hold, correlated[:, :9])
    for index, rng in enumerate(rngs):
        # the filter subtracts its estimates from the samples, so estimation errors enter with opposite sign
        estimated = correlated[index, 9:].reshape(4, 3)
        sampled[index][0][:] -= estimated[:2].ravel()
        sampled[index][1][:, range(3), range(3)] -= estimated[2:]
        if more_errors:
            more = _more(spec, motion, n, rng, changes)
        errors = *sampled[index], *noise, -deflection * G0 * rng.standard_normal(3)
        _kernel.corrupted_run(rng, starts[index], *base, more, *errors, *vertical, rows, states[index])
    return states


def _of_errors(errors: ImuErrors) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Convert bias, sensitivity matrices, non-linearities and g-sensitivity to arrays for the kernel."""
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
    """Build initial states (runs, 10) from standard normal numbers `drawn` and correlated errors, both (runs, 9)."""
    sd = np.array([*3 * [initial.position], *3 * [initial.velocity], initial.tilt, initial.tilt, initial.heading])
    error = drawn * sd + together
    if hold:
        error[:, [2, 5]] = 0.0
    q_hat = quat_multiply(quat_from_rotvec(-error[:, 6:]), quat_from_rph(motion.truth.rph[0]))
    return np.hstack([lla_offset(motion.truth.lla[0], error[:, :3]), motion.truth.v_n[0] + error[:, 3:6], q_hat])


def _more(
    spec: ImuSpec, motion: SampledMotion, n: int, rng: np.random.Generator, changes: FloatArray | None
) -> FloatArray:
    """Sample the sensor errors that the kernel does not sample, ``(n, 6)``."""
    elapsed = motion.elapsed[:n]
    error = np.zeros((n, 6))
    since = (elapsed - elapsed[0])[:, None]
    for part, name in enumerate(SENSORS):
        sensor: SensorSpec = getattr(spec, name)
        sensor_error = error[:, 3 * part : 3 * part + 3]
        sensor_error += further_errors(name, sensor, motion.rate[:n], motion.force[:n], since, rng)
        if np.any(quantisation := noise_of(sensor, "quantisation")):
            steps = rng.uniform(-1.0, 1.0, (n, 3)) * (math.sqrt(3.0) * quantisation)
            sensor_error += np.diff(steps, axis=0, prepend=np.zeros((1, 3))) / motion.dt[:n, None]
        if np.any(size := noise_of(sensor, "flicker")):
            sensor_error += flicker(np.random.SeedSequence(int(rng.integers(2**53))), elapsed, size)
    if changes is not None:
        offset, drift = rng.standard_normal(2) * [spec.clock.offset, spec.clock.drift]
        error -= (offset + drift * elapsed)[:, None] * changes
    return error


def _errors(states: FloatArray, motion: SampledMotion, rows: IntArray) -> FloatArray:
    """Compute errors of states ``(runs, m, 10)`` against the truth, ``(runs, m, 9)``."""
    truth = motion.truth
    lla, v_n, rph = truth.lla[rows], truth.v_n[rows], truth.rph[rows]
    turn = quat_multiply(states[..., 6:], quat_conjugate(quat_from_rph(rph)))
    position = ned_offset(states[..., :3], np.broadcast_to(lla, (*states.shape[:2], 3)))
    return np.concatenate([position, states[..., 3:6] - v_n, -rotvec_from_quat(turn)], axis=-1)


@dataclass(frozen=True, slots=True)
class Column:
    """Standard deviations of the errors by one method."""

    # (m, f, 9) standard deviation of position N, E, D [m], velocity [m/s], attitude [rad] from each family of sources
    parts: FloatArray

    @property
    def total(self) -> FloatArray:
        """Root sum of squares over the independent families, ``(m, 9)``."""
        return np.asarray(np.sqrt(np.sum(self.parts**2, axis=1)))


@dataclass(frozen=True, slots=True)
class SimulatedColumn:
    """Errors of free-inertial Monte Carlo runs."""

    runs: int  # number of runs with all errors
    alone: int  # number of runs with each family alone
    seed: int  # random seed
    parts: FloatArray  # (m, f, 9) RMS error of the runs with one family of sources alone, in the units of `Column`
    total: FloatArray  # (m, 9) RMS error of the runs with all errors together
    nees: FloatArray  # (m,) mean normalised squared error over the runs and states: one if the covariance is true

    @property
    def band(self) -> tuple[float, float]:
        """Limits between which RMS error over true standard deviation lies with probability `BAND`."""
        tails = (0.5 * (1.0 - BAND), 0.5 * (1.0 + BAND))
        low, high = (float(np.sqrt(chi_square(self.runs, p) / self.runs)) for p in tails)
        return low, high


@dataclass(frozen=True, slots=True)
class RecordedColumn:
    """Errors of the windows of a recorded drive."""

    time: FloatArray  # (k,) time since the start of a window [s]
    # (k, 4) RMS error North, East, Down, horizontal, reference variance subtracted [m]; ``NaN`` below its noise
    corrected: FloatArray
    low: FloatArray  # (k, 4) lower limit of the 95 % confidence interval [m]; ``NaN`` with too few windows
    high: FloatArray  # (k, 4) upper limit [m]
    predicted: FloatArray  # (k, 4) predicted standard deviation [m]
    windows: int  # number of windows
    description: str  # description of the windows and of the reference


@dataclass(frozen=True, slots=True)
class Budget:
    """Error budget of an IMU: size of its errors over time, and their sources."""

    imu: str  # name of the IMU
    motion: str  # description of the motion
    time: FloatArray  # (m,) times of the curves, since the start [s]
    chosen: IntArray  # (k,) indices of the times in the tables
    families: tuple[str, ...]  # families of nonzero sources, such as ``gyro bias``
    sources: tuple[Source, ...]  # all sources, including zero ones
    analytic: Column  # standard deviations by closed laws
    covariance: Column  # standard deviations by the linear model along the motion
    # (m, 4) largest error North, East, Down, horizontal with all sources within one sd, by the linear model [m]
    worst: FloatArray
    hold: bool  # True if the vertical channel was constrained to the reference height
    gravity: float  # gravity at the start of the motion [m/s^2]
    schuler_rate: float  # Schuler rate at the start of the motion [rad/s]
    absent: tuple[str, ...]  # absent keys of the IMU file, taken as zero
    ignored: tuple[str, ...]  # errors of the IMU file that the budget does not include
    simulated: SimulatedColumn | None = None
    recorded: RecordedColumn | None = None
    flicker_lowest: float = math.nan  # lowest frequency of the flicker noise [Hz]; NaN without

    @property
    def linear(self) -> bool:
        """True if the attitude errors are small enough for the analytic and the covariance columns."""
        return bool(self.covariance.total[self.chosen, 6:].max() <= LINEAR)

    @property
    def valid(self) -> Column | SimulatedColumn:
        """Valid column: covariance, or simulated if the errors are too large for the linear model."""
        return self.covariance if self.simulated is None or self.linear else self.simulated

    def short_form_error(self, time: float) -> tuple[float, float]:
        """Compute Schuler form / short form - 1 of the position error: from a bias or tilt, and from a gyro bias."""
        bias, drift = (float(predicted.schuler("constant", order, time, self.schuler_rate)) for order in (2, 3))
        return bias - 1.0, drift - 1.0


def budget(
    spec: ImuSpec,
    motion: SampledMotion,
    times: Sequence[float],
    *,
    runs: int = 0,
    seed: int = 1,
    deflection: float = 0.0,
    hold: bool = False,
    known: tuple[Source, ...] = (),
    progress: Callable[[float], None] | None = None,
) -> Budget:
    """Compute the error budget of an IMU on a motion.

    `times`: of the results, since the start [s]. `runs`: number of simulated runs; 0 for analytic and covariance alone.
    `deflection`: deflection of the vertical [rad]; see `insnav.errors.budget.sources.sources_of`. `hold`: constrain the
    vertical channel to the reference height; see `insnav.errors.budget.predicted.covariance`. `known`: correlated
    errors of start and sensors in addition to `spec`; see `start_sources`. `progress`: called with the completed
    fraction of the simulation.
    Raises: ConfigError: an IMU without errors, or times outside the motion.
    """
    sources = (*known, *sources_of(spec, deflection))
    names = families(sources)
    if not names:
        raise ConfigError("budget.no_errors", where="--imu")
    rows, chosen = _rows(motion, times)
    analytic_sd = analytic(sources, motion, rows, hold=hold)
    parts = covariance(sources, motion, rows, hold=hold)
    variance = np.einsum("msii->msi", parts)
    decays = [
        process[2] for s in sources if s.kind == "flicker" and s.sd > 0.0 for process in predicted.processes(s, motion)
    ]
    result = Budget(
        imu=spec.name,
        motion=motion.description,
        time=motion.elapsed[rows - 1],
        chosen=chosen,
        families=names,
        sources=sources,
        analytic=Column(_by_family(analytic_sd**2, sources, names)),
        covariance=Column(_by_family(variance, sources, names)),
        worst=predicted.worst_case(parts),
        hold=hold,
        gravity=predicted.gravity_of(motion),
        schuler_rate=schuler_rate(motion),
        absent=tuple(key for key in not_given(spec) if not (known and _AT_START.match(key))),
        ignored=left_out(spec),
        flicker_lowest=min(decays) / (2.0 * math.pi) if decays else math.nan,
    )
    if runs == 0:
        return result

    def rms(error: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(np.mean(error**2, axis=0)))

    progress_alone = share_of(progress, 0.3, 0.7)
    simulate = partial(free_runs, motion=motion, rows=rows, hold=hold)
    all_errors = simulate(
        spec, runs=runs, seed=(seed, 0), deflection=deflection, known=known, progress=share_of(progress, 0.0, 0.3)
    )
    fewer = min(runs, _ALONE)
    alone = np.zeros((len(rows), len(names), 9))
    for number, name in enumerate(names):
        vertical = deflection if name.startswith("gravity") else 0.0
        joint = tuple(source for source in known if source.family == name)
        family = simulate(only(spec, name), runs=fewer, seed=(seed, 1 + number), deflection=vertical, known=joint)
        alone[:, number] = rms(family)
        if progress_alone is not None:
            progress_alone((number + 1) / len(names))
    simulated = SimulatedColumn(runs, fewer, seed, alone, rms(all_errors), _normalised(all_errors, parts.sum(axis=1)))
    return replace(result, simulated=simulated)


def check_times(times: Sequence[float], longest: float = LONGEST) -> None:
    """Check that times are within the range of a budget.

    `times` [s]. `longest`: end of the motion [s].
    Raises: ConfigError: no times, or some are too short or too long.
    """
    if np.ndim(times) != 1:
        raise ConfigError("budget.times_sequence", where="times", value=str(times))
    wrong = [time for time in times if not SHORTEST <= time <= longest + 1e-6]
    if wrong or len(times) == 0:
        raise ConfigError("budget.bad_times", where="--times", times_s=tuple(wrong), low_s=SHORTEST, high_s=longest)


def _rows(motion: SampledMotion, times: Sequence[float]) -> tuple[IntArray, IntArray]:
    """Select the samples of the curves' points, (m,), and the indices of the requested times among them, (k,)."""
    elapsed = motion.elapsed
    check_times(times, min(LONGEST, float(elapsed[-1])))
    wanted = np.unique(np.searchsorted(elapsed, np.array(times) - 1e-6) + 1)
    last = int(wanted[-1])
    first = max(1, min(int(wanted[0]), last // _CURVE))
    curve = np.concatenate([np.linspace(first, last, _CURVE), np.geomspace(first, last, _CURVE // 3)])
    rows = np.union1d(np.round(curve).astype(np.int64), wanted)
    return rows, np.searchsorted(rows, wanted)


def _by_family(variance: FloatArray, sources: tuple[Source, ...], names: tuple[str, ...]) -> FloatArray:
    """Combine the variances (m, s, 9) from each source to standard deviations (m, f, 9) from each family."""
    members = [[k for k, source in enumerate(sources) if source.family == name] for name in names]
    return np.asarray(np.sqrt(np.stack([variance[:, each].sum(axis=1) for each in members], axis=1)))


def _normalised(error: FloatArray, total: FloatArray) -> FloatArray:
    """Compute the mean ``e' P^-1 e / n`` of the n error states over the runs at every time, (m,)."""
    nees = np.empty(len(total))
    for k, matrix in enumerate(total):
        sd = np.sqrt(np.diag(matrix))
        # states without variance, and exact duplicates of other states, are excluded
        free = np.flatnonzero(sd > 0.0)
        correlation = matrix[np.ix_(free, free)] / np.outer(sd[free], sd[free])
        value, vector = np.linalg.eigh(correlation)
        kept = value > 1e-9
        nees[k] = np.mean(((error[:, k, free] / sd[free]) @ vector[:, kept]) ** 2 / value[kept])
    return nees
