"""Predicted error budget: closed laws for each source, and propagation along the motion by the full linear error model.

The covariance budget includes Earth rate, curvature, Coriolis, turns and accelerations; it assumes small errors. The
model is linear, so the total covariance is the sum over the sources.

The analytic budget has closed short-time laws, and the same integrals along a motion. An accelerometer error is
integrated once to velocity and twice to position: ``B t^2 / 2`` for a bias, ``N t^1.5 / sqrt(3)`` for white noise. A
gyro error is integrated once to a tilt, which couples gravity g into the level axes. Velocity and position are ``g``
times its second and third integral: ``g eps t^3 / 6`` for a bias, ``g N sqrt(t^5 / 20)`` for white noise. Each law is
the standard deviation of an n-fold integral of a unit error (`integral`), without Earth rate and curvature. Compare
Groves (2013), section 14.2 and chapter 5 (short-term error propagation); Titterton and Weston, "Strapdown Inertial
Navigation Technology", 2nd ed. (2004), chapter 12. For integrals of white noise: Papoulis, "Probability, Random
Variables, and Stochastic Processes" (1991), chapter 10.

Beyond two minutes a position error tilts the computed level, as the Earth is curved. `schuler` corrects every integral.

Along a motion, `analytic` integrates each constant error with the attitude and specific force of the motion, and each
noise pulse by pulse. At rest this equals the laws above to the last digit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from insnav.earth import earth_rate_n, gravity_n, radii, transport_rate_n
from insnav.errors.budget.sources import BODY, LOCAL, SampledMotion, Source
from insnav.imu.specification import Process
from insnav.kernels import error_propagation as _kernel
from insnav.kernels.error_propagation import noise_variances
from insnav.simulate.sensor_errors import flicker_processes
from insnav.types import FloatArray, IntArray

SHORTEST, LONGEST = 0.02, 0.1  # limits of the propagation step [s]
_STEPS = 3000  # number of steps, if the step is then within its limits
_CONSTANT = ("constant", "ramp")  # processes with one random number; all others are noise
_DIRECTIONS = 720  # directions of the worst case, 0.25 deg apart: underestimate it by up to 2e-6 [-]
SHORT = 120.0  # the short forms apply up to this time, the closed Schuler forms beyond it [s]
_CLOSED_STEPS = 1500  # number of steps for integrals of noise
# number of integrations of a constant error to tilt, velocity and position; None: no effect of the Schuler loop
_ORDERS = {
    "initial velocity": (None, 0, 1),
    "initial tilt": (0, 1, 2),
    "initial heading": (1, 2, 3),
    "gyro": (1, 2, 3),
    "accel": (None, 1, 2),
    "gravity": (None, 1, 2),
}


@dataclass(frozen=True, slots=True)
class Steps:
    """Motion divided into steps of several samples."""

    state: FloatArray  # (m, 10) in the middle of each step; see `insnav.kernels.mechanization`
    force_n: FloatArray  # (m, 3) mean specific force North, East, Down [m/s^2]
    dt: FloatArray  # (m,) length of each step [s]
    edges: IntArray  # (m + 1,) index of the first sample of each step, and of the end


def steps_of(motion: SampledMotion, rows: IntArray, count: int = _STEPS, longest: float = LONGEST) -> Steps:
    """Combine samples into steps, one of which ends at each requested result.

    `rows` (r,): samples after which results are returned, increasing. `count`: approximate number of steps. `longest`:
    longest step [s].
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
        # the filter subtracts its estimate from the samples, so the estimation error enters with opposite sign
        sensors = np.array(source.joint)[9:].reshape(4, 3)
        return -(sensors[0] + sensors[2] * motion.rate), -(sensors[1] + sensors[3] * motion.force)
    since = motion.elapsed - 0.5 * motion.dt
    if source.group == "timing":
        # the output lags by a unit delay, or by the elapsed time: its error is minus delay times rate of change
        delay = np.ones_like(since) if source.term == "offset" else since
        middle = since + motion.truth.time[0]
        rate, force = (-delay[:, None] * np.gradient(value, middle, axis=0) for value in (motion.rate, motion.force))
        return rate, force
    term, (sensitive, driving) = source.error_term, source.element
    assert term.drive is not None  # every budget term has a driving signal
    error = np.zeros((len(motion.dt), 3))
    error[:, sensitive] = term.drive(motion.rate, motion.force, since[:, None])[:, driving]
    return (error, None) if source.group == "gyro" else (None, error)


def covariance(sources: tuple[Source, ...], motion: SampledMotion, rows: IntArray, *, hold: bool = False) -> FloatArray:
    """Propagate the covariance of the errors from each source alone along a motion.

    `sources`: see `insnav.errors.budget.sources.sources_of`; zero sources are skipped. `rows` (m,): samples after
    which results are returned, increasing. `hold`: constrain the vertical channel to the reference height, the
    free-inertial convention: no errors down. Otherwise it is free, and unstable with an e-folding time of 570 s.
    Returns: (m, s, 9, 9) covariance of the errors of position N, E, D [m], velocity [m/s] and attitude [rad] by each
    source. Their sum is the total covariance. Attitude error: ``C_hat = (I - [phi x]) C``.
    """
    steps = steps_of(motion, rows)
    at = np.searchsorted(steps.edges, rows)
    parts = np.zeros((len(rows), len(sources), 9, 9))
    nonzero = [i for i, source in enumerate(sources) if source.sd > 0.0]
    constant = [i for i in nonzero if sources[i].kind in _CONSTANT]
    noisy = [i for i in nonzero if sources[i].kind not in _CONSTANT]
    if constant:  # one propagated vector per source
        initial, given = np.zeros((len(constant), 9)), np.zeros((len(steps.dt), len(constant), 9))
        for k, i in enumerate(constant):
            source = sources[i]
            initial[k] = source.sd * at_start(source)
            given[:, k] = source.sd * integrated(disturbance(source, motion), motion, steps)
        if hold:
            initial[:, [2, 5]] = 0.0
        response = np.empty((len(rows), len(constant), 9))
        _kernel.sensitivities(steps.state, steps.force_n, steps.dt, given, initial, hold, at, response)
        parts[:, constant] = response[..., :, None] * response[..., None, :]
    if noisy:  # one propagated covariance per process; the sources of one axis share the input
        units = list(dict.fromkeys(unit_of(sources[i]) for i in noisy))
        given = np.stack([integrated(disturbance(each, motion), motion, steps) for each in units], axis=1)
        owner, numbers = zip(*((i, process) for i in noisy for process in processes(sources[i], motion)), strict=True)
        axis = [units.index(unit_of(sources[i])) for i in owner]
        white, drive, decay, begun = np.array(numbers).T.copy()
        response = np.empty((len(rows), len(owner), 9, 9))
        _kernel.noises(
            steps.state, steps.force_n, steps.dt, given, np.array(axis), white, drive, decay, begun, hold, at, response
        )
        for k, i in enumerate(owner):
            parts[:, i] += response[:, k]
    for i in noisy:
        if sources[i].kind == "quantisation":
            last = sources[i].sd * last_step(sources[i], motion, steps.edges[at], hold)
            parts[:, i] += last[:, :, None] * last[:, None, :]
    return parts


def worst_case(parts: FloatArray) -> FloatArray:
    """Compute the largest position errors that occur if every source is within one standard deviation.

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
    worst = np.empty((len(parts), 4))
    worst[:, :3] = np.sqrt(np.einsum("msii->msi", parts[..., :3, :3])).sum(axis=1)
    for row, part in zip(worst, parts[..., :2, :2], strict=True):
        row[3] = np.sqrt(np.maximum(np.einsum("di,sij,dj->ds", u, part, u), 0.0)).sum(axis=1).max()
    return worst


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
    """Integrate sampled rates over each step."""
    values = (values * motion.dt[:, None])[: steps.edges[-1]]
    return np.asarray(np.add.reduceat(values, steps.edges[:-1], axis=0))


def unit_of(source: Source) -> Source:
    """Return the unit source that acts like a noise at each instant: a bias of its axis, or its quantisation."""
    if source.kind == "quantisation":
        return replace(source, sd=1.0)
    return Source(source.group, "bias", source.axis, "constant", 1.0)


def last_step(source: Source, motion: SampledMotion, rows: IntArray, hold: bool) -> FloatArray:
    """Compute the direct effect ``B e`` of a unit quantisation error e of the last sample, ``(m, 9)``."""
    out = np.zeros((len(rows), 9))
    along = motion.C_nb[rows - 1, :, BODY.index(source.axis)]
    if source.group == "gyro":
        out[:, 6:] = -along
    else:
        out[:, 3:6] = along * [1.0, 1.0, 0.0 if hold else 1.0]
    return out


def processes(source: Source, motion: SampledMotion) -> list[tuple[float, float, float, float]]:
    """Decompose a noise into processes: white density, driving density, decay rate [1/s], initial variance.

    `source`: not constant. `motion`: its length and sampling rate determine the processes of flicker noise.
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
    # processes for the duration without the first interval, as in the simulation
    share, times = flicker_processes(spacing, motion.elapsed[-1] - spacing)
    return [_markov(variance * share**2, tau) for tau in times]


def _markov(variance: float, tau: float) -> tuple[float, float, float, float]:
    return 0.0, (2.0 * variance / tau if math.isfinite(tau) else 0.0), 1.0 / tau, variance


def integral(kind: Process, order: int, time: ArrayLike) -> FloatArray:
    """Compute the standard deviation of the n-fold integral of a unit error that begins at time zero.

    `kind`: process of the error, ``constant``, ``ramp``, ``white`` or ``random walk``; see
    `insnav.imu.specification.ErrorTerm`. `order`: n; `time` [s].
    Returns: [s^n], [s^(n + 1)] for a ramp, [s^(n - 1/2)] for white noise, [s^(n + 1/2)] for a random walk.

    Notes
    -----
    A constant: ``t^n / n!``. A ramp is the integral of a constant, n + 1. The n-fold integral of white noise w is
    ``int (t - u)^(n-1) / (n-1)! w(u) du``, so its variance is ``t^(2n-1) / ((2n-1) (n-1)!^2)``: t, t^3/3, t^5/20,
    t^7/252. A random walk is the integral of white noise, n + 1.
    """
    t = np.asarray(time, dtype=np.float64)
    if kind in ("ramp", "random walk"):
        return integral("constant" if kind == "ramp" else "white", order + 1, t)
    if kind == "constant":
        return np.asarray(t**order / math.factorial(order))
    return np.asarray(t ** (order - 0.5) / (math.sqrt(2 * order - 1) * math.factorial(order - 1)))


def schuler(kind: Process, order: int, time: ArrayLike, rate: float) -> FloatArray:
    """Compute the factor by which the closed Schuler loop multiplies the short form of an n-fold integral.

    `kind`: process of the error; slow processes (Gauss-Markov, flicker) count as constant. `time` [s], above zero.
    `rate`: Schuler rate ``sqrt(g / R)`` [rad/s].
    Returns: factor, which tends to one for short times.

    Notes
    -----
    The loop ``dv' = -g phi + B``, ``phi' = dv / R - eps`` multiplies the short form of a constant by a factor of
    x = w_s t. For n = 0 to 4 it is ``cos x``, ``sin x / x``, ``2 (1 - cos x) / x^2``, ``6 (x - sin x) / x^3`` and
    ``24 (x^2 / 2 - 1 + cos x) / x^4``. Sources up to n = 3: Groves (2013), section 5.7; Titterton and Weston (2004),
    chapter 12. White noise: integral of the squared response of one order less.
    """
    x = rate * np.asarray(time, dtype=np.float64)
    if kind in ("ramp", "random walk"):
        return schuler("constant" if kind == "ramp" else "white", order + 1, time, rate)
    s, c = np.sin(x), np.cos(x)
    if kind == "white":
        squares = (
            x / 2 + s * c / 2,
            x / 2 - s * c / 2,
            1.5 * x - 2 * s + s * c / 2,
            x**3 / 3 + 2 * x * c - 2 * s + x / 2 - s * c / 2,
        )
        return np.asarray(np.sqrt(squares[order - 1]) / integral("white", order, x))
    responses = (c, s, 1 - c, x - s, x * x / 2 - 1 + c)
    return np.asarray(responses[order] / integral("constant", order, x))


def gravity_of(motion: SampledMotion) -> float:
    """Compute gravity at the start of a motion [m/s^2]."""
    lat, _, height = motion.truth.lla[0]
    return float(np.linalg.norm(gravity_n(lat, height)))


def schuler_rate(motion: SampledMotion) -> float:
    """Compute the Schuler rate at the start of a motion, ``sqrt(g / R)`` with the mean radius of curvature [rad/s]."""
    lat, _, height = motion.truth.lla[0]
    return float(np.sqrt(gravity_of(motion) / (np.mean(radii(lat)) + height)))


def analytic(sources: tuple[Source, ...], motion: SampledMotion, rows: IntArray, *, hold: bool = False) -> FloatArray:
    """Compute the standard deviation of the errors from each source by closed forms.

    `rows` (m,): samples after which results are returned, increasing.
    Returns: (m, s, 9): of position N, E, D [m], velocity [m/s], attitude [rad]. Short forms apply up to `SHORT`,
    then the closed Schuler forms in the level axes. The vertical channel uses the short forms at all times.
    """
    time, rate = motion.elapsed[rows - 1], schuler_rate(motion)
    out = np.zeros((len(rows), len(sources), 9))
    steps = steps_of(motion, rows, count=_CLOSED_STEPS, longest=math.inf)
    ends = np.searchsorted(steps.edges, rows)
    for k, source in enumerate(sources):
        if source.sd == 0.0:
            continue
        if source.kind in ("constant", "ramp"):
            out[:, k] = source.sd * np.abs(_constant(source, motion)[rows]) * _in_the_loop(source, time, rate)
        else:
            out[:, k] = _noise(source, motion, steps, ends, np.where(time > SHORT, rate, 0.0))
    if hold:
        out[..., [2, 5]] = 0.0
    return out


def _constant(source: Source, motion: SampledMotion) -> FloatArray:
    """Compute errors from a unit constant source at the ends of all samples, ``(n + 1, 9)``.

    ``phi' = -C e_gyro``, ``dv' = f x phi + C e_accel``, ``dp' = dv``. Rotation of the level axes is included only where
    it alone couples an error: heading into the tilt, ``phi' = -w_in x psi``, vertical velocity into the level axes.
    """
    dt = motion.dt[:, None]
    state, rate = np.tile(at_start(source), (len(dt) + 1, 1)), disturbance(source, motion)
    phi, velocity, position = state[:, 6:], state[:, 3:6], state[:, :3]
    heading, lat = state[0, 8], motion.lla[:, 0]
    w_ie, w_en = earth_rate_n(lat), transport_rate_n(lat, motion.lla[:, 2], motion.v_n)
    rate[:, :3] -= np.cross(w_ie + w_en, [0.0, 0.0, heading])
    phi[1:] += np.cumsum(rate[:, :3] * dt, axis=0)
    push = np.cross(motion.force_n, 0.5 * (phi[1:] + phi[:-1])) + rate[:, 3:6]
    push[:, :2] -= np.cross(2.0 * w_ie + w_en, (np.cumsum(push * dt, axis=0) + velocity[0]) * [0.0, 0.0, 1.0])[:, :2]
    velocity[1:] += np.cumsum(push * dt, axis=0)
    position[1:] += np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * dt, axis=0)
    return state


def _noise(source: Source, motion: SampledMotion, steps: Steps, at: IntArray, loop: FloatArray) -> FloatArray:
    """Compute standard deviations from a noise, ``(m, 9)``.

    `at` (m,): steps after which results are returned. `loop` (m,): Schuler rate, zero for the short forms.

    Notes
    -----
    Pulse responses at u: a velocity error ``c`` becomes ``(t - u) c`` of position. An attitude error ``a`` couples the
    specific force into the velocity, ``(F(t) - F(u)) x a`` with its integral F, and so on. Their squares, or products
    with the autocorrelation of the noise, are integrated over u (Papoulis 1991, chapter 10). At rest this gives the
    laws of `integral`.
    """
    dt = steps.dt
    given = integrated(disturbance(unit_of(source), motion), motion, steps) / dt[:, None]
    velocity = np.concatenate([np.zeros((1, 3)), np.cumsum(steps.force_n * dt[:, None], axis=0)])
    position = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * dt[:, None], axis=0)
    position = np.concatenate([np.zeros((1, 3)), position])
    white, drive, decay, first = np.array(processes(source, motion)).T.copy()
    # Gauss-Markov process over one step: exponent x of its decay, and integral `gained` of the decay
    x = np.minimum(dt[:, None] * decay, 700.0)
    tau = 1.0 / np.maximum(decay, 1e-30)
    gained = np.where(x > 0.0, -np.expm1(-x) * tau, dt[:, None])
    # double integral of exp(-|u - v| / tau) over the step, by its series where the closed form cancels
    alone = np.where(x > 0.01, 2.0 * (x - 1.0 + np.exp(-x)) * tau**2, dt[:, None] ** 2 * (1.0 - x / 3.0))
    variance = np.empty((len(at), 9))
    driven = np.where(first > 0.0, 0.0, drive)
    noise_variances(dt, velocity, position, given, loop, at, white, driven, first, np.exp(-x), gained, alone, variance)
    if source.kind == "quantisation":
        variance += (source.sd * last_step(source, motion, steps.edges[at], hold=False)) ** 2
    return np.asarray(np.sqrt(variance))


def _in_the_loop(source: Source, time: FloatArray, rate: float) -> FloatArray:
    """Compute the factor by which the Schuler loop multiplies each error, ``(m, 9)``; one up to `SHORT`."""
    factor = np.ones((len(time), 9))
    orders = _ORDERS.get(source.family) or _ORDERS.get(source.group)
    late = time > SHORT
    if orders is None or not late.any():
        return factor
    for order, columns in zip(orders, (slice(6, 8), slice(3, 5), slice(0, 2)), strict=True):
        if order is not None:
            factor[late, columns] = np.abs(schuler(source.kind, order, time[late], rate))[:, None]
    return factor
