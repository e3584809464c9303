"""Study of a requirement on the position error: real IMUs that meet it after GPS ends, and remedies for the others.

Simulated runs verify the allocation. For each IMU, a filter has GPS before an outage and other aiding in it. Its
covariance follows the full linear error model of the budget, second by second. The propagation in a second is common
to all IMUs; only the sizes of their errors differ. It is a Schmidt filter ("Application of state-space methods to
navigation problems", Advances in Control Systems 3 (1966) 293-340): it estimates position, velocity, attitude, biases
and scale factors. It considers other constant errors of datasheets (misalignment, g-sensitivity) without estimating
them. It does estimate accelerometer misalignment that acts as a bias through gravity.

The filter leaves correlated errors, such as a tilt that compensates a bias. Their variances do not add up, and neither
first-order nor total indices give the share of a single error. The Shapley effect shares the variance among the errors
as the Shapley value shares a gain among players. The gain of a group is the variance that it explains (Owen, "Sobol'
indices and Shapley value", SIAM/ASA Journal on Uncertainty Quantification 2 (2014) 245-251; Song, Nelson and Staum,
"Shapley effects for global sensitivity analysis: theory and computation", the same 4 (2016) 1060-1083). For a linear
map of Gaussian errors it has a closed form, and all groups are enumerated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy.linalg import solve

from insnav.attitude import skew
from insnav.engine import Workers
from insnav.errors.budget.error_budget import free_runs
from insnav.errors.budget.predicted import disturbance, integrated, steps_of
from insnav.errors.budget.sources import SampledMotion, Source, families, sampled, sources_of, term_of
from insnav.errors.requirement.allocation import Allocation, Requirement, binomial_interval, last_sample
from insnav.findings import Code, Finding
from insnav.imu import ImuSpec, SensorSpec, load_imu
from insnav.imu.library import Part, completed
from insnav.imu.specification import TERMS, Sensor, noise_of_both, terms_of
from insnav.kernels import error_propagation as _kernel
from insnav.simulate.truth import Truth
from insnav.types import FloatArray
from insnav.units import DEG, PPM, UG

RATE = 20.0  # sampling rate of the motion [Hz]
NAV = 9  # number of navigation errors: position, velocity, attitude
# constant errors of gyros and accelerometers: first biases and scale factors, which the filter estimates
_TERMS = sorted(
    (term for term in TERMS if term.datasheet and term.process == "constant"),
    key=lambda term: term.key not in ("bias", "scale_factor"),
)
_UNITS = tuple(Source(term.sensor, term.name, axis, "constant", 1.0) for term in _TERMS for axis in term.axes)
# states: navigation, constant bias, in-run bias, scale factor (each gyro, accel), considered errors. Then odometer
# scale, mounting pitch and yaw, offset of the barometer
BIAS, IN_RUN, SCALE, CONSIDERED = 9, 15, 21, 27
SENSED = IN_RUN + len(_UNITS)
ODOMETER, MOUNTING, BAROMETER, STATES = SENSED, SENSED + 1, SENSED + 3, SENSED + 4
# a misaligned level accelerometer senses a part of gravity, which the filter estimates as bias
_AS_BIAS = [IN_RUN + k for k, unit in enumerate(_UNITS) if unit.family == "accel misalignment" and unit.axis[1] == "z"]
_CONSIDERED = np.setdiff1d(np.arange(CONSIDERED, SENSED), _AS_BIAS)
# assumed standard deviations of GPS before the outage, of the initial state and of other aiding
POSITION_SD, VELOCITY_SD = 0.02, 0.03  # horizontal sd of fixes [m], [m/s]
START_TILT, START_HEADING = 1.0 * DEG, 10.0 * DEG
NHC_SD, ODOMETER_SD, ZUPT_SD, BAROMETER_SD = 0.05, 0.1, 0.02, 0.3  # sd of aiding: [m/s], [m/s], [m/s], [m]
HEADING_SD = 0.2 * DEG  # sd of the heading of two antennas
_MOUNTING_SD, _ODOMETER_SCALE_SD, _BAROMETER_DRIFT = 1.0 * DEG, 0.02, 0.02  # sd [rad], sd [-], [m/sqrt(s)]
_MOVING, _STANDING = 2.0, 0.01  # speed above which travel has a direction; speed of a stationary vehicle [m/s]
# groups of initial states
GROUPS: dict[str, list[int]] = {
    "position": [0, 1, 2],
    "velocity": [3, 4, 5],
    "tilt": [6, 7],
    "heading": [8],
    "gyro bias": [9, 10, 11, 15, 16, 17],
    "accelerometer bias": [12, 13, 14, 18, 19, 20],
    "gyro scale factor": [21, 22, 23],
    "accelerometer scale factor": [24, 25, 26],
    "gyro misalignment": list(range(27, 33)),
    "accelerometer misalignment": list(range(33, 39)),
    "g-sensitivity": list(range(39, 48)),
}
_RIDGE = 1e-10  # added to the diagonal of correlations: permits zero and linearly dependent errors
NOISE = "noise of the outage"  # name of the variance share of noise after GPS ends
Answer = Literal["yes", "likely", "open", "no"]
LIMITS = (1.0, 10.0, 100.0)  # error limits whose times are reported [m]
# errors after a calibration, one standard deviation: assumptions for good benches
RATE_TABLE = {"scale_factor": 50.0 * PPM, "misalignment": 0.1e-3}  # gyro errors
NINE_POSITION = {"bias": 100.0 * UG, "scale_factor": 50.0 * PPM, "misalignment": 0.1e-3}  # accelerometer errors
STOPS = 10.0  # interval between stops with zero-velocity update [s]
SHORT, LONG = 60.0, 300.0  # duration of GPS before the outage [s]
LARGER = 1.25  # a set with all errors larger by this factor must fail the requirement


@dataclass(frozen=True, slots=True)
class Aiding:
    """Aiding in addition to GPS before the outage."""

    nhc: bool = False  # non-holonomic constraint, and ZUPT during stops
    odometer: bool = False
    barometer: bool = False
    zupt_every: float = math.inf  # interval of one-second stops in the outage [s]
    dual_antenna: bool = False  # heading of two antennas with the fixes
    before: float = math.inf  # duration of GPS before the outage [s]; infinite: all available


@dataclass(frozen=True, slots=True)
class Propagation:
    """Error propagation in each second of a motion, and its outages."""

    begins: tuple[int, ...]  # seconds in which GPS ends, one per outage
    length: int  # length of every outage [s]
    by_state: FloatArray  # (k, 9, 48) navigation errors at the end of a second per unit error at its start
    by_noise: FloatArray  # (k, 6, 9, 9) covariance from unit white noise of gyros and accelerometers
    # attitude (k, 3, 3) and velocity (k, 3) [m/s] at the end of each second
    C_nb: FloatArray
    v_n: FloatArray

    @property
    def after(self) -> FloatArray:
        """Result times of an outage, ``(m,)`` [s]; the first is zero."""
        return np.arange(self.length + 1, dtype=np.float64)


def propagation(truth: Truth, begins: Sequence[float], length: float) -> Propagation:
    """Compute the error propagation in each second of a motion, up to the end of the last outage.

    `begins`: times from the start of the motion to the end of GPS [s], increasing. `length`: length of the outages [s].
    """
    seconds = [math.floor(begin) for begin in begins]
    outage = min(math.ceil(length), math.floor(truth.duration + 1e-9) - seconds[-1])
    motion = sampled(truth, begins[-1] - seconds[-1], seconds[-1] + outage, rate=RATE)
    per_second = round(RATE)
    count = len(motion.dt) // per_second
    ends = per_second * (1 + np.arange(count))
    steps = steps_of(motion, ends)
    inputs = np.stack([integrated(disturbance(source, motion), motion, steps) for source in _UNITS], axis=1)
    edges = np.searchsorted(steps.edges, np.append(0, ends))
    by_state, by_noise = np.empty((count, NAV, SENSED)), np.empty((count, 6, NAV, NAV))
    first = np.concatenate([np.eye(NAV), np.zeros((len(_UNITS), NAV))])
    zeros, ones, zero = np.zeros((len(first), inputs.shape[2])), np.ones(6), np.zeros(6)
    for k in range(count):
        part = slice(edges[k], edges[k + 1])
        x, force, dt = steps.state[part], steps.force_n[part], steps.dt[part]
        inner = np.broadcast_to(zeros, (len(dt), *zeros.shape)).copy()
        inner[:, NAV:] = inputs[part]
        row, response = np.array([len(dt)]), np.empty((1, len(first), NAV))
        _kernel.sensitivities(x, force, dt, inner, first.copy(), False, row, response)
        by_state[k, :, :IN_RUN] = response[0, :IN_RUN].T
        by_state[k, :, IN_RUN:SCALE] = response[0, BIAS:IN_RUN].T
        by_state[k, :, SCALE:] = response[0, IN_RUN:].T
        noise = np.empty((1, 6, NAV, NAV))
        six = np.ascontiguousarray(inputs[part, :6])
        _kernel.noises(x, force, dt, six, np.arange(6), ones, zero, zero, zero, False, row, noise)
        by_noise[k] = noise[0]
    return Propagation(tuple(seconds), outage, by_state, by_noise, motion.C_nb[ends - 1], motion.truth.v_n[ends])


def start_covariance(spec: ImuSpec) -> FloatArray:
    """Build the covariance of all states before the first fix, ``(52, 52)``."""
    sd = np.zeros(STATES)
    sd[:3], sd[3:6], sd[6:8], sd[8] = 1.0, 1.0, START_TILT, START_HEADING
    constants = [getattr(getattr(spec, term.sensor), term.key)[i] for term in _TERMS for i, _ in term.elements]
    in_run = noise_of_both(spec, "Gauss-Markov")
    sd[BIAS:SENSED] = np.concatenate([constants[: IN_RUN - BIAS], in_run, constants[IN_RUN - BIAS :]])
    sd[ODOMETER], sd[MOUNTING : MOUNTING + 2], sd[BAROMETER] = _ODOMETER_SCALE_SD, _MOUNTING_SD, 10.0
    return np.diag(sd**2)


def aided_covariances(
    moved: Propagation, specs: Sequence[ImuSpec], aiding: Aiding = Aiding()
) -> tuple[FloatArray, FloatArray]:
    """Run the filter for every IMU, with GPS up to each of the seconds `begins` and without GPS afterwards.

    Returns: (w, b, 52, 52) covariance when GPS ends, for w outages and b IMUs. (w, b, m, 9, 9) covariance of navigation
    errors in each second of the outages, starting when GPS ends.
    """
    process = _process(specs)
    outages, at_end = [], []
    start = np.stack([start_covariance(spec) for spec in specs])
    P, k = start, 0
    for begin in moved.begins:
        if math.isfinite(aiding.before):
            P, k = start, max(begin - round(aiding.before), 0)
        while k < begin:
            k += 1
            P = _second(moved, P, k, aiding, process, gps=True)
        at_end.append(P)
        Q, through = P, np.empty((len(specs), moved.length + 1, NAV, NAV))
        through[:, 0] = Q[:, :NAV, :NAV]
        for m in range(1, moved.length + 1):
            Q = _second(moved, Q, begin + m, aiding, process, gps=False, stop=m % aiding.zupt_every == 0)
            through[:, m] = Q[:, :NAV, :NAV]
        outages.append(through)
    return np.stack(at_end), np.stack(outages)


def error_curves(required: Requirement, moved: Propagation, specs: Sequence[ImuSpec], aiding: Aiding) -> FloatArray:
    """Compute the expected error of each IMU in an outage, ``(b, m)`` [m], at the required probability."""
    # the mean covariance over the outages gives the expected error in any outage
    return required.sizes(np.mean(aided_covariances(moved, specs, aiding)[1], axis=0))


def _second(
    moved: Propagation,
    P: FloatArray,
    k: int,
    aiding: Aiding,
    process: tuple[FloatArray, FloatArray, FloatArray],
    *,
    gps: bool,
    stop: bool = False,
) -> FloatArray:
    """Propagate the covariance to the end of second k."""
    P = _predicted(P, moved.by_state[k - 1], moved.by_noise[k - 1], *process)
    H, R = _measured(moved, k, aiding, gps=gps, stop=stop)
    return _updated(P, H, R) if len(H) else P


def _process(specs: Sequence[ImuSpec]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the decay factor per second (b, 52), white noise density (b, 6) and added variance per second (b, 52)."""
    keep, drive = np.ones((len(specs), STATES)), np.zeros((len(specs), STATES))
    white = np.stack([noise_of_both(spec, "white") ** 2 for spec in specs])
    for b, spec in enumerate(specs):
        keep[b, IN_RUN:SCALE] = np.exp(-1.0 / np.repeat([spec.gyro.correlation_time, spec.accel.correlation_time], 3))
        drive[b, IN_RUN:SCALE] = noise_of_both(spec, "Gauss-Markov") ** 2 * (1.0 - keep[b, IN_RUN:SCALE] ** 2)
        drive[b, BIAS:IN_RUN] = noise_of_both(spec, "random walk") ** 2
    drive[:, BAROMETER] = _BAROMETER_DRIFT**2
    return keep, white, drive


def _predicted(
    P: FloatArray, by_state: FloatArray, by_noise: FloatArray, keep: FloatArray, white: FloatArray, drive: FloatArray
) -> FloatArray:
    # `by_state` propagates the navigation errors from all sensor errors, which decay by `keep`
    top = by_state @ P[:, :SENSED, :]
    out = P * keep[:, :, None] * keep[:, None, :]
    out[:, :NAV, NAV:] = top[:, :, NAV:] * keep[:, None, NAV:]
    out[:, NAV:, :NAV] = out[:, :NAV, NAV:].swapaxes(1, 2)
    out[:, :NAV, :NAV] = top[:, :, :SENSED] @ by_state.T + np.einsum("bs,sij->bij", white, by_noise)
    rows = np.arange(STATES)
    out[:, rows, rows] += drive
    return out


def _measured(moved: Propagation, k: int, aiding: Aiding, *, gps: bool, stop: bool) -> tuple[FloatArray, FloatArray]:
    """Return the measurements at the end of second k: measurement matrix ``(m, 52)``, standard deviations ``(m,)``."""
    rows: list[FloatArray] = []
    sd: list[float] = []

    def add(size: float, *parts: tuple[int | slice, float | FloatArray]) -> None:
        row = np.zeros(STATES)
        for where, value in parts:
            row[where] = value
        rows.append(row)
        sd.append(size)

    C_nb, v_n = moved.C_nb[k - 1], moved.v_n[k - 1]
    if gps:
        for axis in range(3):
            add(POSITION_SD * (1 + axis // 2), (axis, 1.0))
            add(VELOCITY_SD * (1 + axis // 2), (3 + axis, 1.0))
        if aiding.dual_antenna:
            add(HEADING_SD, (8, 1.0))
    speed = float(np.linalg.norm(v_n))
    if speed > _MOVING:
        # attitude error phi with C_hat = (I - [phi x]) C makes the velocity error in body axes C' (dv + phi x v)
        by_attitude = C_nb.T @ -skew(v_n)
        if aiding.nhc:
            add(NHC_SD, (slice(3, 6), C_nb[:, 1]), (slice(6, 9), by_attitude[1]), (MOUNTING + 1, speed))
            add(NHC_SD, (slice(3, 6), C_nb[:, 2]), (slice(6, 9), by_attitude[2]), (MOUNTING, -speed))
        if aiding.odometer:
            add(ODOMETER_SD, (slice(3, 6), C_nb[:, 0]), (slice(6, 9), by_attitude[0]), (ODOMETER, speed))
    stationary = aiding.nhc and speed < _STANDING and bool(np.any(np.abs(moved.v_n) > _MOVING))
    if aiding.barometer:
        add(BAROMETER_SD, (2, 1.0), (BAROMETER, 1.0))
    if stop or stationary:
        for axis in range(3):
            add(ZUPT_SD, (3 + axis, 1.0))
    return np.array(rows).reshape(len(rows), STATES), np.array(sd)


def _updated(P: FloatArray, H: FloatArray, sd: FloatArray) -> FloatArray:
    """Update the covariance without correcting the considered states, by the form that is valid for any gain."""
    HP = H @ P
    S = HP @ H.T + np.diag(sd**2)
    K = np.linalg.solve(S, HP).swapaxes(1, 2).copy()
    K[:, _CONSIDERED] = 0.0
    reduction = K @ HP
    out = P - reduction - reduction.swapaxes(1, 2) + K @ S @ K.swapaxes(1, 2)
    return 0.5 * (out + out.swapaxes(1, 2))


def shapley_effects(gain: FloatArray, covariance: FloatArray, groups: Sequence[Sequence[int]]) -> FloatArray:
    """Divide the trace of the covariance of ``gain @ x`` among groups of correlated Gaussian inputs x.

    `gain` (m, n). `covariance` (n, n) of x. `groups`: indices of the inputs of each group, covering all inputs.
    Returns: variance of each group; their sum is the trace.
    """
    count = len(groups)
    explained = np.zeros(1 << count)
    for subset in range(1, 1 << count):
        inside = [i for k in range(count) if subset >> k & 1 for i in groups[k]]
        across = gain @ covariance[:, inside]
        block = covariance[np.ix_(inside, inside)]
        # states have different units, so the equations are solved with correlations instead of covariances
        size = np.sqrt(np.maximum(np.diag(block), 1e-300))
        correlation = block / np.outer(size, size) + _RIDGE * np.eye(len(inside))
        explained[subset] = np.sum((across / size) * solve(correlation, (across / size).T, assume_a="pos").T)
    weights = [math.factorial(s) * math.factorial(count - s - 1) / math.factorial(count) for s in range(count)]
    effects = np.zeros(count)
    for subset in range(1 << count):
        members = subset.bit_count()
        for k in range(count):
            if not subset >> k & 1:
                effects[k] += weights[members] * (explained[subset | 1 << k] - explained[subset])
    return effects


def start_shares(
    moved: Propagation, at_end: FloatArray, through: FloatArray, axes: Sequence[int], after: int
) -> dict[str, float]:
    """Compute the shares of initial errors and outage noise in the position variance of outages.

    `at_end` (w, 52, 52): covariance when GPS ends. `through` (w, m, 9, 9): of navigation errors in the outages.
    `axes`: relevant axes of North, East, Down. `after`: time since the start of the outage [s].
    """
    largest = np.diagonal(at_end, axis1=1, axis2=2).max(axis=0)
    present = {name: states for name, states in GROUPS.items() if np.any(largest[states] > 0.0)}
    values, total = np.zeros(len(present)), 0.0
    below = np.eye(SENSED)[NAV:]
    for begin, start, errors in zip(moved.begins, at_end, through, strict=True):
        gain = np.eye(SENSED)
        for by_state in moved.by_state[begin : begin + after]:
            gain = np.vstack([by_state @ gain, below])
        values += shapley_effects(gain[list(axes)], start[:SENSED, :SENSED], list(present.values()))
        total += float(np.trace(errors[after][np.ix_(axes, axes)]))
    shares = {name: float(value) / total for name, value in zip(present, values, strict=True)}
    return {**shares, NOISE: max(1.0 - sum(shares.values()), 0.0)}


@dataclass(frozen=True, slots=True)
class Coasting:
    """Error growth of an IMU after GPS ends."""

    error: float  # error at the time and probability of the requirement [m]
    least: float  # lower bound of `error`, with zero for undocumented figures [m]
    answer: Answer
    curve: FloatArray  # (m,) error at the required probability, at the times of the study [m]
    reaches: tuple[float, ...]  # times at which it exceeds each of `LIMITS` [s]; infinite if never


@dataclass(frozen=True, slots=True)
class Candidate:
    """Real IMU evaluated for the requirement."""

    name: str
    grade: str
    provenance: str
    missing: tuple[str, ...]  # undocumented figures, taken from its class
    alone: Coasting  # error growth of the IMU alone
    nhc: Coasting  # error growth with the non-holonomic constraint


def candidates(required: Requirement, moved: Propagation, parts: Sequence[Part]) -> tuple[Candidate, ...]:
    """Evaluate IMUs twice: with undocumented figures from their class, and with zero for these figures."""
    grades = {grade: load_imu(grade) for grade in {part.grade for part in parts}}
    specs = [completed(part, grades[part.grade])[0] for part in parts] + [part.spec for part in parts]
    alone, aided = (error_curves(required, moved, specs, Aiding(nhc=nhc)) for nhc in (False, True))
    evaluated = []
    for i, part in enumerate(parts):
        both = [
            coasting(required, moved, curves[i], curves[len(parts) + i], known=not part.missing)
            for curves in (alone, aided)
        ]
        evaluated.append(Candidate(part.name, part.grade, part.provenance, part.missing, *both))
    return tuple(sorted(evaluated, key=lambda each: each.alone.error))


def coasting(
    required: Requirement, moved: Propagation, curve: FloatArray, least: FloatArray, *, known: bool
) -> Coasting:
    """Evaluate an error curve: yes or no if documented figures decide; likely if only class figures meet the limit."""
    time = moved.after
    error, smallest = (float(np.interp(required.after, time, values)) for values in (curve, least))
    smallest = error if known else smallest
    if error <= required.error:
        answer: Answer = "yes" if known else "likely"
    else:
        answer = "no" if smallest > required.error else "open"
    return Coasting(error, smallest, answer, curve, tuple(_reaches(time, curve, limit) for limit in LIMITS))


def _reaches(time: FloatArray, curve: FloatArray, limit: float) -> float:
    """Find the first time at which a curve exceeds a limit, by linear interpolation; infinite if never."""
    over = np.flatnonzero(curve > limit)
    if not over.size:
        return float("inf")
    k = int(over[0])
    if k == 0:
        return 0.0
    return float(time[k - 1] + (limit - curve[k - 1]) / (curve[k] - curve[k - 1]) * (time[k] - time[k - 1]))


@dataclass(frozen=True, slots=True)
class Remedy:
    """Remedy, and the error with it."""

    name: str  # name of the remedy
    error: float  # error at the time and probability of the requirement [m]
    ratio: float  # relative to the error of the unchanged IMU


@dataclass(frozen=True, slots=True)
class Elasticity:
    """Sensitivity of the error to one family of errors of the IMU."""

    family: str
    halved: float  # relative change of the error if this family were halved
    elasticity: float  # d log(error) / d log(size)


def remedies(
    required: Requirement, moved: Propagation, spec: ImuSpec, part: Part | None = None
) -> tuple[tuple[Remedy, ...], tuple[Elasticity, ...]]:
    """Evaluate every remedy for an IMU, and halve each of its errors. The first remedy is the unchanged IMU."""
    aiding = {
        "as it is": Aiding(),
        "NHC": Aiding(nhc=True),
        "odometer": Aiding(odometer=True),
        "NHC and odometer": Aiding(nhc=True, odometer=True),
        f"ZUPT: a stop every {STOPS:g} s": Aiding(zupt_every=STOPS),
        "barometer": Aiding(barometer=True),
        "dual antenna: heading at every fix": Aiding(dual_antenna=True),
        f"GPS of {SHORT:g} s only before the outage": Aiding(before=SHORT),
    }
    if min(moved.begins) <= SHORT:
        aiding.popitem()
    changed = {
        "rate table: gyro scale factor, misalignment": at_most(spec, "gyro", RATE_TABLE),
        "nine positions: accelerometer bias, scale factor, misalignment": at_most(spec, "accel", NINE_POSITION),
    }
    warm = None if part is None else at_constant_temperature(spec, part)
    if warm is not None:
        changed["warm-up, constant temperature: in-run bias of the Allan deviation"] = warm
    names = [name for name in families(sources_of(spec)) if not name.startswith("initial")]
    halves = [halved(spec, name) for name in names]
    errors = {name: _errors(required, moved, [spec], each)[0] for name, each in aiding.items()}
    changed_errors = _errors(required, moved, [*changed.values(), *halves], Aiding())
    errors |= dict(zip(changed, changed_errors, strict=False))
    base = errors["as it is"]
    results = tuple(Remedy(name, error, error / base) for name, error in errors.items())
    changes = [error / base for error in changed_errors[len(changed) :]]
    return results, tuple(
        Elasticity(name, change - 1.0, math.log(change) / math.log(0.5))
        for name, change in zip(names, changes, strict=True)
    )


def _errors(required: Requirement, moved: Propagation, specs: Sequence[ImuSpec], aiding: Aiding) -> list[float]:
    curves = error_curves(required, moved, specs, aiding)
    return [float(np.interp(required.after, moved.after, curve)) for curve in curves]


def at_most(spec: ImuSpec, sensor: Sensor, sizes: dict[str, float]) -> ImuSpec:
    """Limit the errors of a sensor to `sizes`, which remain after a calibration."""
    old = getattr(spec, sensor)
    new = replace(old, **{key: np.minimum(getattr(old, key), size) for key, size in sizes.items()})
    return replace(spec, **{sensor: new})


def at_constant_temperature(spec: ImuSpec, part: Part) -> ImuSpec | None:
    """Replace the in-run bias by the Allan deviation's minimum; None if undocumented or already used."""
    changed = {}
    for sensor in ("gyro", "accel"):
        old = getattr(spec, sensor)
        floors = [
            figure.sd
            for figure in part.figures
            if figure.key == f"{sensor}.bias_instability" and figure.statistic == "Allan minimum"
        ]
        least: FloatArray = np.minimum.reduce([old.bias_instability, *floors])
        if not np.array_equal(least, old.bias_instability):
            changed[sensor] = replace(old, bias_instability=least)
    return replace(spec, **changed) if changed else None


def halved(spec: ImuSpec, family: str) -> ImuSpec:
    """Halve one family of errors of a specification."""
    term = term_of(family)
    old = getattr(spec, term.sensor)
    return replace(spec, **{term.sensor: replace(old, **{term.key: 0.5 * getattr(old, term.key)})})


@dataclass(frozen=True, slots=True)
class Verified:
    """Simulated runs of a set of errors."""

    factor: float  # factor on all errors of the set
    runs: int
    within: int  # runs within the limit
    error: float  # error that the share `probability` of the runs does not exceed [m]
    interval: tuple[float, float]  # 95 % interval of the probability of an error within the limit

    def meets(self, probability: float) -> bool:
        """Return whether the interval reaches the requested probability."""
        return self.interval[1] >= probability


def scaled(spec: ImuSpec, factor: float) -> ImuSpec:
    """Scale every error of a specification by a factor."""

    def larger(sensor: SensorSpec, name: Sensor) -> SensorSpec:
        keys = [term.key for term in terms_of(name) if term.in_budget]
        return replace(sensor, **{key: factor * getattr(sensor, key) for key in keys})

    start = spec.initial
    if start is not None:
        start = replace(start, **{key: factor * getattr(start, key) for key in start.__dataclass_fields__})
    return replace(spec, gyro=larger(spec.gyro, "gyro"), accel=larger(spec.accel, "accel"), initial=start)


def verify(
    required: Requirement,
    spec: ImuSpec,
    motion: SampledMotion,
    runs: int,
    seed: int,
    *,
    factor: float = 1.0,
    hold: bool = False,
    workers: Workers = 1,
    progress: Callable[[float], None] | None = None,
) -> Verified:
    """Simulate runs with all errors scaled by `factor`, and count the runs within the limit."""
    row = np.array([last_sample(motion, required.after)])
    seeds, larger = (seed, round(100 * factor)), scaled(spec, factor)
    error = free_runs(larger, motion, row, runs, seeds, hold=hold, workers=workers, progress=progress)[:, 0]
    size = np.linalg.norm(error[:, list(required.axes)], axis=1)
    count = int(np.count_nonzero(size <= required.error))
    return Verified(factor, runs, count, float(np.quantile(size, required.probability)), binomial_interval(count, runs))


@dataclass(frozen=True, slots=True)
class RequirementStudy:
    """Requirement on a motion, the errors that just meet it, and suitable IMUs."""

    required: Requirement
    motion: str  # description of the motion
    imu: str  # name of the IMU with given errors; empty if none
    allocation: Allocation
    hold: bool  # the vertical channel was constrained to the reference height
    verified: tuple[Verified, ...] = ()  # the set, and a larger one, simulated
    begins: tuple[int, ...] = ()  # end of GPS in the following outages, whose mean is shown [s]
    time: FloatArray = field(default_factory=lambda: np.zeros(0))  # (m,) times of the candidates' curves [s]
    candidates: tuple[Candidate, ...] = ()  # real IMUs, the best first; empty if the outage is too long
    # IMU of `remedies`, `elasticities` and `shares`: the given IMU, else the best one that fails the requirement alone
    example: str = ""
    remedies: tuple[Remedy, ...] = ()
    elasticities: tuple[Elasticity, ...] = ()
    shares: Mapping[str, float] = field(default_factory=dict)  # variance shares of initial errors and later noise


TYPICAL = 1.6  # geometric mean of recorded over predicted error
SPAN = (0.53, 4.9)  # interval of this ratio in 95 % of further tests
FIELD_FACTOR = Finding.of(Code.REQUIREMENT_FIELD_FACTOR, factor=TYPICAL, low=SPAN[0], high=SPAN[1])
