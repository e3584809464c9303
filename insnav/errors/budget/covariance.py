"""Covariance budget: each source propagated along the motion with the full linear error model.

Only the errors are assumed small: Earth rate, curvature, Coriolis, turns and accelerations are included. The model is
linear, so the total covariance is the sum over the sources.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from insnav.earth import earth_rate_n, transport_rate_n
from insnav.errors.budget.sources import BODY, LOCAL, SampledMotion, Source
from insnav.kernels import error_propagation as _kernel
from insnav.simulate.imu_errors import flicker_processes
from insnav.types import FloatArray, IntArray

SHORTEST, LONGEST = 0.02, 0.1  # steps of the propagation [s]
_STEPS = 3000  # number of steps, if this length allows it
_CONSTANT = ("constant", "ramp")
_DIRECTIONS = 720  # a quarter of a degree: underestimates a worst case by up to 2e-6


@dataclass(frozen=True, slots=True)
class Steps:
    """Motion divided into steps of several samples."""

    state: FloatArray  # (m, 10) in the middle of each step; see `insnav.kernels.mechanization`
    force_n: FloatArray  # (m, 3) mean specific force North, East, Down [m/s^2]
    dt: FloatArray  # (m,) [s]
    edges: IntArray  # (m + 1,) numbers of the first samples


def steps_of(motion: SampledMotion, rows: IntArray, count: int = _STEPS, longest: float = LONGEST) -> Steps:
    """Join samples to steps that end at the requested results.

    `rows` (r,): samples after which results are returned, increasing. `count`: approximate number of steps. `longest`:
    [s].
    """
    step = min(max(float(motion.elapsed[rows[-1] - 1]) / count, SHORTEST), longest)
    size = max(1, round(step / float(np.median(motion.dt))))
    edges = np.union1d(np.arange(0, rows[-1], size), np.append(0, rows)).astype(np.int64)
    samples = np.diff(edges)[:, None]

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.add.reduceat(values[: rows[-1]], edges[:-1], axis=0) / samples)

    # longitude, whose mean fails across the date line, and attitude are not used later
    state = np.concatenate([mean(motion.lla), mean(motion.v_n), np.zeros((len(samples), 4))], axis=1)
    return Steps(state, mean(motion.force_n), mean(motion.dt[:, None])[:, 0] * samples[:, 0], edges)


def disturbance(source: Source, motion: SampledMotion) -> FloatArray:
    """Compute the rates of attitude and velocity errors from a unit source.

    Returns: (n, 9): rate of the attitude error [rad/s], of the velocity error [m/s^2] and of the position error [m/s],
    North, East, Down, in every sample: ``phi' = ... - C e_gyro``, ``dv' = ... + C e_accel`` (compare Groves 2013,
    section 14.2.4). Quantisation e acts on the integral, ``x' = F x + B e'``. The returned ``F B - B'`` multiplies e
    and drives ``x - B e``.
    """
    out = np.zeros((len(motion.dt), 9))
    if source.kind == "quantisation":
        axis = np.eye(3)[BODY.index(source.axis)]
        along, turning = motion.C_nb @ axis, np.einsum("kij,kj->ki", motion.C_nb, np.cross(motion.rate, axis))
        if source.group == "gyro":
            out[:, :3], out[:, 3:6] = turning, -np.cross(motion.force_n, along)
        else:
            lat, height = motion.lla[:, 0], motion.lla[:, 2]
            w = 2.0 * earth_rate_n(lat) + transport_rate_n(lat, height, motion.v_n)
            out[:, :3], out[:, 3:6] = transport_rate_n(lat, height, along), -turning - np.cross(w, along)
            out[:, 6:] = along
        return out
    if source.group == "initial" and not source.joint:
        return out
    if source.group == "gravity":
        out[:, 3 + LOCAL.index(source.axis)] = 1.0
        return out
    gyro, accel = _sensed(source, motion)
    if gyro is not None:
        out[:, :3] = -np.einsum("kij,kj->ki", motion.C_nb, gyro)
    if accel is not None:
        out[:, 3:6] = np.einsum("kij,kj->ki", motion.C_nb, accel)
    return out


def _sensed(source: Source, motion: SampledMotion) -> tuple[FloatArray | None, FloatArray | None]:
    """Compute errors of gyros and accelerometers, body axes, ``(n, 3)``; None without errors."""
    if source.joint:
        # the estimate of the sensor error, including its own error, was corrected
        sensors = np.array(source.joint)[9:].reshape(4, 3)
        return -(sensors[0] + sensors[2] * motion.rate), -(sensors[1] + sensors[3] * motion.force)
    since = motion.elapsed - 0.5 * motion.dt
    if source.group == "timing":
        # a delay of tau, or growing with time: the output shows the past
        late = np.ones_like(since) if source.term == "offset" else since
        middle = since + motion.truth.time[0]
        rate, force = (-late[:, None] * np.gradient(value, middle, axis=0) for value in (motion.rate, motion.force))
        return rate, force
    term, (shown, driving) = source.error_term, source.element
    assert term.drive is not None  # a budget term
    error = np.zeros((len(motion.dt), 3))
    error[:, shown] = term.drive(motion.rate, motion.force, since[:, None])[:, driving]
    return (error, None) if source.group == "gyro" else (None, error)


def covariance(sources: tuple[Source, ...], motion: SampledMotion, rows: IntArray, *, hold: bool = False) -> FloatArray:
    """Propagate each source alone along a motion.

    `sources`: see `insnav.errors.budget.sources.sources_of`; zero sources cost nothing. `rows` (m,): samples after
    which results are returned, increasing. `hold`: constrain the vertical channel to the reference height, the
    free-inertial convention: no errors down. Otherwise it is free, and unstable with an e-folding time of 570 s.
    Returns: (m, s, 9, 9) covariance of the errors of position N, E, D [m], velocity [m/s] and attitude [rad] by each
    source. Their sum is the total covariance. Attitude error: ``C_hat = (I - [phi x]) C``.
    """
    steps = steps_of(motion, rows)
    at = np.searchsorted(steps.edges, rows)
    parts = np.zeros((len(rows), len(sources), 9, 9))
    here = [i for i, source in enumerate(sources) if source.sd > 0.0]
    constant = [i for i in here if sources[i].kind in _CONSTANT]
    noisy = [i for i in here if sources[i].kind not in _CONSTANT]
    if constant:
        first, given = np.zeros((len(constant), 9)), np.zeros((len(steps.dt), len(constant), 9))
        for k, i in enumerate(constant):
            source = sources[i]
            first[k] = source.sd * at_start(source)
            given[:, k] = source.sd * integrated(disturbance(source, motion), motion, steps)
        if hold:
            first[:, [2, 5]] = 0.0
        found = np.empty((len(rows), len(constant), 9))
        _kernel.sensitivities(steps.state, steps.force_n, steps.dt, given, first, hold, at, found)
        parts[:, constant] = found[..., :, None] * found[..., None, :]
    if noisy:
        ways = list(dict.fromkeys(unit_of(sources[i]) for i in noisy))
        given = np.stack([integrated(disturbance(each, motion), motion, steps) for each in ways], axis=1)
        owner, numbers = zip(*((i, process) for i in noisy for process in processes(sources[i], motion)), strict=True)
        axis = [ways.index(unit_of(sources[i])) for i in owner]
        white, drive, decay, begun = np.array(numbers).T.copy()
        found = np.empty((len(rows), len(owner), 9, 9))
        _kernel.noises(
            steps.state, steps.force_n, steps.dt, given, np.array(axis), white, drive, decay, begun, hold, at, found
        )
        for k, i in enumerate(owner):
            parts[:, i] += found[:, k]
    for i in noisy:
        if sources[i].kind == "quantisation":
            last = sources[i].sd * last_step(sources[i], motion, steps.edges[at], hold)
            parts[:, i] += last[:, :, None] * last[:, None, :]
    return parts


def worst_case(parts: FloatArray) -> FloatArray:
    """Compute the largest position errors if every source is within one standard deviation.

    `parts` (m, s, 9, 9): from `covariance`.
    Returns: (m, 4): North, East, Down, horizontal [m].

    Notes
    -----
    The maximum effect of a source in a direction u is ``sqrt(u' P u)``, for a constant of either sign ``|u' e|``. The
    maximum of all together is their sum. This holds for North, East and Down. The horizontal error is the largest sum
    over all horizontal directions (support function of a sum of ellipsoids: Schneider, "Convex Bodies: The
    Brunn-Minkowski Theory", 2nd ed. 2014, theorem 1.7.5).
    """
    angle = np.linspace(0.0, np.pi, _DIRECTIONS, endpoint=False)
    u = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = np.empty((len(parts), 4))
    found[:, :3] = np.sqrt(np.einsum("msii->msi", parts[..., :3, :3])).sum(axis=1)
    for row, part in zip(found, parts[..., :2, :2], strict=True):
        reach = np.einsum("di,sij,dj->ds", u, part, u)
        row[3] = np.sqrt(np.maximum(reach, 0.0)).sum(axis=1).max()
    return found


def at_start(source: Source) -> FloatArray:
    """Compute errors of position, velocity and attitude at the start from a unit source, ``(9,)``."""
    if source.joint:
        return np.array(source.joint[:9])
    out = np.zeros(9)
    if source.group == "initial":
        first = {"position": 0, "velocity": 3, "tilt": 6, "heading": 6}[source.term]
        out[first + LOCAL.index(source.axis)] = 1.0
    return out


def integrated(values: FloatArray, motion: SampledMotion, steps: Steps) -> FloatArray:
    """Integrate rates of samples over steps."""
    values = (values * motion.dt[:, None])[: steps.edges[-1]]
    return np.asarray(np.add.reduceat(values, steps.edges[:-1], axis=0))


def unit_of(source: Source) -> Source:
    """Return the unit source through which a noise enters: a bias of its axis, or its quantisation."""
    if source.kind == "quantisation":
        return replace(source, sd=1.0)
    return Source(source.group, "bias", source.axis, "constant", 1.0)


def last_step(source: Source, motion: SampledMotion, rows: IntArray, hold: bool) -> FloatArray:
    """Compute errors from a unit error of the last step of a quantised integral, ``(m, 9)``."""
    out = np.zeros((len(rows), 9))
    along = motion.C_nb[rows - 1, :, BODY.index(source.axis)]
    if source.group == "gyro":
        out[:, 6:] = -along
    else:
        out[:, 3:6] = along * [1.0, 1.0, 0.0 if hold else 1.0]
    return out


def processes(source: Source, motion: SampledMotion) -> list[tuple[float, float, float, float]]:
    """Return the processes of a noise: density of white part, driving density, decay [1/s], first variance.

    `source`: not constant. `motion`: its length and sampling determine the processes of flicker noise.
    """
    variance = source.sd**2
    if source.kind == "white":
        return [(variance, 0.0, 0.0, 0.0)]
    if source.kind == "random walk":
        return [(0.0, variance, 0.0, 0.0)]
    if source.kind == "quantisation":
        return [(variance * float(np.median(motion.dt)), 0.0, 0.0, 0.0)]
    if source.kind == "Gauss-Markov":
        return [_markov(variance, source.correlation_time)]
    spacing = float(np.median(motion.dt))
    # as in the simulation: the first sample of a record has no earlier interval
    share, times = flicker_processes(spacing, motion.elapsed[-1] - spacing)
    return [_markov(variance * share**2, tau) for tau in times]


def _markov(variance: float, tau: float) -> tuple[float, float, float, float]:
    return 0.0, (2.0 * variance / tau if math.isfinite(tau) else 0.0), 1.0 / tau, variance
