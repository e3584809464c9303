"""The whole record decides which fixes were false: filter and smoother repeated with robust weights.

The gates of the filter decide once, in order of time, from one side: a false first fix is believed, and a long row of
false ones is followed by a reset onto their track. After the smoother every fix can be compared with what all others,
earlier and later, say. Where filter and smoother contradict each other, the drive is navigated a few times more,
without gates: all fixes weak at first, then each weighted by its residual from the smoothed track. The weight is that
of Geman and McClure, made strict step by step (graduated non-convexity), so that no start decides.

References
----------
Yang, Antonante, Tzoumas, Carlone, "Graduated Non-Convexity for Robust Spatial Perception: From Non-Minimal Solvers to
Global Outlier Rejection", IEEE Robotics and Automation Letters 5 (2020) 1127-1134: the Geman-McClure surrogate.
Agamennoni, Nieto, Nebot, "Approximate Inference in State-Space Models With Heavy-Tailed Noise", IEEE Transactions on
Signal Processing 60 (2012) 5024-5037: smoothing repeated with weights of each measurement.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from insnav.attitude import dcm_from_rph
from insnav.earth import lla_offset, ned_offset
from insnav.filter.gates import Gates, Trust
from insnav.filter.parts import LONGEST_GAP
from insnav.filter.settings import FilterSettings
from insnav.sample_statistics import chi2_limit
from insnav.types import BoolArray, Event, EventKind, FloatArray, GpsData, IntArray, Run

OPEN = Gates(max_sd=np.inf, max_speed=np.inf, probability=1.0, reset_after=np.inf)  # no gate: the weights decide
PASSES = 5
# In the first pass standard deviations are so many times those reported, in the last as reported: this is the control
# parameter, from nearly convex to strict. Positions start the weaker: frozen or shifted ones contradict the velocities
# beside them only by their integral, and many of them together would decide against few velocities.
WIDEST = (3000.0, 3.0)
STRICTNESS = (100.0, 30.0, 10.0, 3.0, 1.0)  # the other schedule: limits so many times wider, deviations as reported
ALONE = 10.0  # positions without velocities: with more, the IMU alone would lead the track too far
FALSE = 0.1  # a fix of less weight is not used at all
LIMIT = chi2_limit(3, 0.01)  # squared normalised residual of three numbers at which a weight falls to a quarter [-]
GROSS = chi2_limit(3, 1e-9)  # of an accepted fix: filter and smoother contradict each other [-]
MEDIAN = chi2_limit(3, 0.5)
AGREEMENT = 2.0  # median squared residual, in parts of what it should be, up to which weights have made fixes agree
MOST = 0.5  # share of fixes that may be false: beyond it they are not what the others contradict
FAR = 300.0  # false positions nearer than that are not told from true ones without velocities [m]
LONGEST = 3.0  # fixes that the smoothed track supports may be rejected for so long [s]
ENDS = 0.2  # a fix so little before or after the track is compared with its end [s]
# likelihood of runs, twice its negative logarithm: from where on the NIS of a fix counts by its logarithm, what a
# fix costs that was not used, and as much more a row of them, however long: a false one is seldom alone [-]
LARGEST, UNUSED, EPISODE = 30.0, 10.0, 30.0
OPEN_START = 3000.0  # standard deviation of a first position that may be false [m]


@dataclass(frozen=True, slots=True)
class Residuals:
    """Fixes minus smoothed track, both at the antenna."""

    # (n, 3) North, East, Down [m], [m/s]; ``NaN`` where the fix has none or lies outside the track
    position: FloatArray
    velocity: FloatArray
    # (n,) squared and normalised by reported and smoothed standard deviation: 3 on average, if both are true
    square_position: FloatArray
    square_velocity: FloatArray


@dataclass(frozen=True, slots=True)
class Reconciled:
    """What the whole record says of the fixes."""

    run: Run  # the first run if nothing contradicted it, else that with the weights found
    events: tuple[Event, ...] = ()  # which fixes were found false, or that it cannot be told


def residuals(run: Run, gps: GpsData, settings: FilterSettings) -> Residuals:
    """Compare fixes with the smoothed track, velocities with that of the time they are of."""
    assert run.smoothed is not None
    track = run.smoothed.solution
    assert track.sd is not None
    time = gps.time - settings.delay
    after, lla = _between(track.time, track.lla, time)
    late, v_n = _between(track.time, track.v_n, time - settings.velocity_lag)
    antenna = lla_offset(lla, dcm_from_rph(track.rph[after]) @ run.lever_b)
    turned = dcm_from_rph(track.rph[late]) - dcm_from_rph(track.rph[late - 1])  # the antenna swings about the IMU
    swing = turned @ run.lever_b / (track.time[late] - track.time[late - 1])[:, None]
    position, velocity = ned_offset(gps.lla, antenna), gps.v_n - v_n - swing
    outside = (time < track.time[0] - ENDS) | (time > track.time[-1] + ENDS)
    near = np.minimum(time - track.time[after - 1], track.time[after] - time) <= ENDS
    outside |= (track.time[after] - track.time[after - 1] > LONGEST_GAP) & ~near
    position[outside] = velocity[outside] = np.nan
    sd = track.sd[after]
    return Residuals(
        position,
        velocity,
        np.sum(position**2 / (gps.position_sd**2 + sd[:, :3] ** 2), axis=1),
        np.sum(velocity**2 / (gps.velocity_sd**2 + sd[:, 3:6] ** 2), axis=1),
    )


def _between(time: FloatArray, values: FloatArray, wanted: FloatArray) -> tuple[IntArray, FloatArray]:
    """Row behind each wanted time, and the values there on straight lines, constant beyond the ends."""
    after = np.clip(np.searchsorted(time, wanted), 1, time.shape[0] - 1)
    part = np.clip((wanted - time[after - 1]) / (time[after] - time[after - 1]), 0.0, 1.0)[:, None]
    return after, values[after - 1] + part * (values[after] - values[after - 1])


def reconcile(
    first: Run, gps: GpsData, settings: FilterSettings, again: Callable[[GpsData, Trust | None, float], Run]
) -> Reconciled:
    """Find the fixes that the whole record contradicts, where filter and smoother contradict each other.

    `settings`: of the first run; a residual that its gates call small is never false; `again`: navigates once more:
    fixes, which of them to leave out, and a standard deviation to be added to the first position [m].
    """
    scale = _scales(first)
    reason = ""
    # the first schedule holds where fixes are good, the second where many in a row are false
    for annealed in [True, False] if np.isfinite(gps.v_n).any() else [True]:
        decided, reason = _decide(first, gps, settings, again, scale, annealed=annealed)
        if decided is not None:
            return decided
    told = f"{reason}; the decisions of the filter stand (events.csv)"
    return Reconciled(first, (_event(float(first.innovations.time[0]), float("nan"), "", told),))


def _decide(
    first: Run,
    gps: GpsData,
    settings: FilterSettings,
    again: Callable[[GpsData, Trust | None, float], Run],
    scale: tuple[float, float],
    *,
    annealed: bool,
) -> tuple[Reconciled | None, str]:
    """Weights by one schedule, and the run made with them; or None, and why they are not believed."""
    gates, alone = settings.gates, not np.isfinite(gps.v_n).any()
    widest = (ALONE, 1.0) if alone else WIDEST
    ones = np.ones(gps.time.shape[0])
    weights = (ones, ones) if annealed else (ones * widest[0] ** -2.0, ones * widest[1] ** -2.0)
    for left, strictness in zip(np.linspace(1.0, 0.0, PASSES), STRICTNESS, strict=True):
        wide = _weighted(gps, widest[0] ** (-2.0 * left), widest[1] ** (-2.0 * left)) if annealed else gps
        found = residuals(again(_weighted(wide, *weights), None, OPEN_START), wide, settings)
        squares = found.square_position / scale[0], found.square_velocity / scale[1]
        limit = LIMIT if annealed else strictness * LIMIT
        weights = _geman_mcclure(squares[0], limit), _geman_mcclure(squares[1], limit)
    size = np.linalg.norm(found.position, axis=1), np.linalg.norm(found.velocity, axis=1)
    trust = Trust(
        (weights[0] < FALSE) & (size[0] > gates.small_position),
        (weights[1] < FALSE) & (size[1] > gates.small_velocity),
        *size,
    )
    agreement = max(float(np.nanmedian(square)) / MEDIAN for square in squares if np.isfinite(square).any())
    false = trust.false_position
    if agreement > AGREEMENT or float(np.mean(false)) > MOST:
        return None, (
            "fixes and IMU contradict each other, and no weighting of the fixes makes them agree: half of the "
            f"residuals from the smoothed track exceed {np.sqrt(agreement):.2g} times their size"
        )
    if alone and float(np.max(size[0][false], initial=0.0)) < FAR:
        return None, "fixes and IMU contradict each other, and without GPS velocities it cannot be told which are false"
    if false.any() and float(np.mean(trust.false_velocity[false])) > MOST:
        return None, "positions and velocities of the same fixes contradict the IMU: either may be wrong"
    begin = int(np.searchsorted(gps.time, first.alignment.time, side="right")) + 1  # fixes up to the first one used
    weights = np.where(false, 1.0, weights[0]), np.where(trust.false_velocity, 1.0, weights[1])
    run = again(_weighted(gps, *weights), trust, OPEN_START if false[:begin].any() else 0.0)
    if _diverged(run) > _diverged(first):
        return None, "fixes and IMU contradict each other, and leaving fixes out makes it worse"
    return Reconciled(run, tuple(told_false(gps, trust))), ""


def _diverged(run: Run) -> int:
    """Windows whose innovations are far from their predicted size."""
    return sum(event.kind == EventKind.DIVERGED for event in run.events)


def _scales(run: Run) -> tuple[float, float]:
    """How much larger squared innovations of position and velocity are than they should be; no less than one."""
    both = run.innovations.nis_position, run.innovations.nis_velocity
    first, second = (
        max(1.0, float(np.median(nis[np.isfinite(nis)])) / MEDIAN) if np.isfinite(nis).any() else 1.0 for nis in both
    )
    return first, second


def unlikely(run: Run, gps: GpsData, settings: FilterSettings, dragged: Trust | None = None) -> float:
    """Twice the negative log-likelihood of all fixes against white noise of the reported standard deviations.

    A fix that was not used costs more than those that were, but for positions that were `dragged` all together.
    """
    found, rows = run.innovations, _rows_of(run, gps, settings)
    total = EPISODE * sum(event.kind is EventKind.RESET for event in run.events)
    for nis, sd, reported, used in (
        (found.nis_position, found.sd[:, :3], gps.position_sd[rows], found.used_position),
        (found.nis_velocity, found.sd[:, 3:], gps.velocity_sd[rows], found.used_velocity),
    ):
        known = np.isfinite(nis)
        large = LARGEST * (1.0 + np.log(np.maximum(nis, LARGEST) / LARGEST))  # heavy tails
        cost = (np.where(nis > LARGEST, large, nis) + 2.0 * np.log(sd / reported).sum(axis=1))[known & used]
        usual = float(np.median(cost)) if cost.size else 0.0
        total += float(np.sum(cost)) + int((known & ~used).sum()) * (UNUSED + usual)
        total += EPISODE * len(stretches(found.time, known & ~used))
    if dragged is not None:
        total -= (UNUSED - 1.0) * int(dragged.false_position[rows].sum())
    return total


def _rows_of(run: Run, gps: GpsData, settings: FilterSettings) -> IntArray:
    """Row of the fix of each innovation."""
    return np.searchsorted(gps.time - settings.delay, run.innovations.time - 1e-6)


def contradicted(run: Run, gps: GpsData, settings: FilterSettings) -> bool:
    """Whether the filter reset, believed a fix that the smoothed track contradicts, or rejected many it supports."""
    if any(event.kind is EventKind.RESET for event in run.events):
        return True
    gates, found, scale = settings.gates, residuals(run, gps, settings), _scales(run)
    rows = _rows_of(run, gps, settings)
    squares = found.square_position[rows] / scale[0], found.square_velocity[rows] / scale[1]
    believed = run.innovations.used_position, run.innovations.used_velocity
    large = (
        np.linalg.norm(found.position[rows], axis=1) > 2.0 * gates.small_position,
        np.linalg.norm(found.velocity[rows], axis=1) > 2.0 * gates.small_velocity,
    )
    if any(
        bool(np.any(square[used & far] > GROSS)) for square, used, far in zip(squares, believed, large, strict=True)
    ):
        return True
    offered = np.isfinite(run.innovations.nis_position)
    supported = np.asarray(offered & ~believed[0] & (squares[0] < LIMIT))
    return any(stop - start > LONGEST for start, stop in stretches(run.innovations.time, supported))


def _geman_mcclure(square: FloatArray, limit: float) -> FloatArray:
    """Weight of a squared normalised residual; one where there is none."""
    return np.asarray(np.where(np.isfinite(square), (limit / (limit + square)) ** 2, 1.0))


def _weighted(gps: GpsData, position: FloatArray | float, velocity: FloatArray | float) -> GpsData:
    """Fixes whose standard deviations say how much they are trusted."""
    factors = [np.reshape(np.sqrt(np.maximum(weight, 1e-8)), (-1, 1)) for weight in (position, velocity)]
    return replace(gps, position_sd=gps.position_sd / factors[0], velocity_sd=gps.velocity_sd / factors[1])


def stretches(time: FloatArray, chosen: BoolArray) -> list[tuple[float, float]]:
    """First and last time of each unbroken row of chosen fixes."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(np.int8), [0]])))
    return [(float(time[start]), float(time[stop - 1])) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def _event(time: float, size: float, unit: str, told: str) -> Event:
    return Event(time, EventKind.CONTRADICTION, size, float("nan"), unit, told)


def told_false(gps: GpsData, trust: Trust) -> list[Event]:
    """What was found false, as a warning each."""
    found = []
    for name, false, size, unit in (
        ("position", trust.false_position, trust.position_residual, "m"),
        ("velocity", trust.false_velocity, trust.velocity_residual, "m/s"),
    ):
        if false.any():
            spans = [
                f"{start:.1f} s" if start == stop else f"{start:.1f} to {stop:.1f} s"
                for start, stop in stretches(gps.time, false)
            ]
            listed = ", ".join(spans[:3]) + (f" and {len(spans) - 3} more" if len(spans) > 3 else "")
            largest = float(np.nanmax(size[false]))
            several = false.sum() > 1
            told = f"{int(false.sum())} {name} " + ("fixes contradict" if several else "fix contradicts")
            told += f" the whole record by up to {largest:.3g} {unit} and {'were' if several else 'was'} not used: "
            found.append(_event(float(gps.time[false][0]), largest, unit, told + listed))
    return found
