"""Where fixes and IMU part for good, by so little at a time that no gate sees it: jumps, drags, steps of biases.

The adjoint of the smoother is the derivative of the log-likelihood of all later innovations by a change of the state,
and its matrix the information on that: the change that explains them best follows at every epoch, without another run
(P. de Jong, J. Penzer, "Diagnosing shocks in time series", J. Am. Stat. Assoc. 93 (1998) 796-806). Beside position,
velocity, attitude and biases a state is looked at that the filter lacks: a minute of drift that velocities do not know.
What would not be seen follows from the same information (minimal detectable bias: W. Baarda, "A testing procedure for
use in geodetic networks", Netherlands Geodetic Commission 2/5 (1968)).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from insnav.filter.smoother import SmoothedErrors
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import STATES
from insnav.kernels.smoother import DRAG, SHOCK
from insnav.types import BoolArray, FloatArray, Innovations, StateChange
from insnav.units import DEG


class Kind(NamedTuple):
    """A kind of change, and from where on it is said."""

    first: int  # of the three error states
    # twice the gain of the log-likelihood, chi-square with three degrees of freedom: of a true model once in 10^7
    # epochs; recorded drives without a fault have up to 28 in drifts, 50 in biases; simulated ones
    # in towns 35.3 in velocities [-]
    limit: float
    beside: float  # so near a change shows, too; drifts fill many of the few minutes [s]
    least: float = 0.0  # size; biases of good sensors change by less


POSITION, VELOCITY, ATTITUDE = Kind(0, 35.0, 20.0), Kind(3, 40.0, 20.0), Kind(6, np.inf, 120.0)
GYRO, ACCEL = Kind(NAV, 60.0, 120.0, 0.02 * DEG), Kind(NAV + 3, 60.0, 120.0, 0.02)
DRIFT = Kind(0, 35.0, np.inf)  # beside velocities
KINDS = POSITION, VELOCITY, ATTITUDE, GYRO, ACCEL, DRIFT  # as the kernel has them
OF_FIXES = POSITION, VELOCITY, DRIFT  # the smallest that would be seen is stated
TRIED = 45.0  # twice the gain of the log-likelihood from which a change may be one of several [-]
USUAL = 4.0  # times what the drive shows a third time: recorded ones have more than the model has
LATE = 35.0  # of a change of the delay: recorded and simulated drives without a fault have up to 17 [-]
PERHAPS = 0.5  # part of the gain of any other change, which true positions of another time have, too
LEAST_LATE = 0.05  # smaller ones are also what models of receivers and IMUs lack [s]
LATE_START = 15.0  # so long after a start the attitude is good enough for that [s]
BEGIN_AND_END = 2  # a drag has both
AT_REST = 1.0  # [m/s]
# so long after a start at rest, after one in motion, before and after a departure the attitude is not yet that of a
# linear model: a departure tells heading and misalignments at once [s]
START, IN_MOTION, BEFORE, AFTER = 10.0, 60.0, 10.0, 20.0
# innovations so near tell how large noise is there [s], so many before each how alike they are, none beyond so many sd
NEAR, LAGS, LARGEST = 10.0, 3, 3.0
NEARLY_ALL = 0.9  # of the epochs see what is stated as seen
NINE_IN_TEN = 1.28  # standard deviations by which a change must exceed the limit to be seen nine times in ten


class Shocks(NamedTuple):
    """Changes of the state that later innovations ask for."""

    surest: StateChange | None  # the one that stands out most, if one does
    likely: tuple[StateChange, ...]  # of each kind, where other explanations fail, too; the clearest first
    # (3,) jump of the position [m], change of velocity and a minute of drift [m/s] that would have been seen nine times
    # in ten in all but a tenth of the record
    smallest: FloatArray
    late: StateChange | None  # of the delay (1,) [s], if it stands out
    sure: bool  # no other change explains as much


def shocks(found: SmoothedErrors, innovations: Innovations) -> Shocks:
    """Changes that stand out; without GPS velocities there is nothing that a drift is beside of."""
    rows = settled(found)
    time, smallest = found.time[rows], dict.fromkeys(OF_FIXES, np.inf)
    squares, count = scatter(innovations, time)
    velocities = bool(np.isfinite(innovations.nis_velocity).any())
    wide = np.sqrt(np.maximum(squares / count, 1.0))
    worst, surest, likely = 1.0, None, list[StateChange]()
    for kind, columns in zip(KINDS, np.split(found.shocks[rows], len(KINDS), axis=1), strict=True):
        gain, vectors, sd = np.nan_to_num(columns[:, 0]), columns[:, 1:4], columns[:, SHOCK - 1]
        if not gain.any() or (kind is DRIFT and not velocities):
            continue
        part = gain / np.maximum((squares - gain) / count, 1.0)
        gain = np.where(part > min(kind.limit, TRIED), gain, part)
        row, usual = clearest(time, gain, kind.beside)
        value, at = float(gain[row]), float(time[row])
        change = StateChange(at, kind.first, vectors[row], value)
        if kind is DRIFT:
            change = StateChange(at + DRAG, kind.first, DRAG * vectors[row], value, at)
        seen = max(kind.limit, usual)
        if kind in OF_FIXES:
            excess = np.sqrt(seen / kind.limit)  # of what the drive shows over what the model has
            smallest[kind] = (np.sqrt(seen) + NINE_IN_TEN * excess) * np.nanquantile(wide * sd, NEARLY_ALL)
        if value > worst * seen and np.linalg.norm(vectors[row]) > kind.least:
            worst, surest = value / seen, change
        if value > max(TRIED, usual):
            likely.append(change)
    likely.sort(key=lambda change: -change.gain)
    return Shocks(surest, tuple(likely), np.array(list(smallest.values())), *late(found))


def scatter(innovations: Innovations, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Squares of the normalised innovations about each time (m,), and how many numbers they are of.

    What follows each other alike counts as often as it is alike: squares are those of the long-run variance (W. K.
    Newey, K. D. West, Econometrica 55 (1987) 703-708). A gain of likelihood counts in parts of this variance without
    it, as with noise of unknown size (P. McCullagh, J. A. Nelder, "Generalized Linear Models", 1989, ch. 9).
    """
    u = np.clip(np.nan_to_num(innovations.innovation / innovations.sd), -LARGEST, LARGEST)
    each = np.sum(u**2, axis=1)
    for lag in range(1, LAGS + 1):
        each[lag:] += 2.0 * (1.0 - lag / (LAGS + 1)) * np.sum(u[lag:] * u[:-lag], axis=1)
    known = np.isfinite(innovations.innovation).sum(axis=1)
    first, last = (np.searchsorted(innovations.time, time + by) for by in (-NEAR, NEAR))
    squares, count = (np.concatenate([[0.0], np.cumsum(some)]) for some in (each, known))
    return squares[last] - squares[first], np.maximum(count[last] - count[first], 1.0)


def late(found: SmoothedErrors) -> tuple[StateChange | None, bool]:
    """Change of the delay that stands out, if no other change explains much more; and whether none explains more."""
    rows = found.time > found.time[0] + LATE_START
    gains = np.nan_to_num(np.column_stack([found.late[rows, 0], *found.shocks[rows, ::SHOCK].T]))
    if gains.shape[0] == 0 or gains[:, 0].max() < max(LATE, PERHAPS * gains.max()):
        return None, False
    row = int(np.argmax(gains[:, 0]))
    change = found.late[rows][row, 1:]
    if abs(change[0]) < LEAST_LATE:
        return None, False
    step = StateChange(float(found.time[rows][row]), STATES, change, float(gains[row, 0]))
    return step, bool(gains[row, 0] >= gains.max())


def settled(found: SmoothedErrors) -> BoolArray:
    """Epochs that are neither soon after the start nor near the first departure, (m,)."""
    moving = np.linalg.norm(found.state[:, 3:6], axis=1) > AT_REST
    off = found.time[np.argmax(moving)] if moving.any() else np.inf
    at_rest = (found.time > found.time[0] + START) & (found.time < off - BEFORE)
    return np.asarray(at_rest | (found.time > off + (IN_MOTION if moving[0] else AFTER)))


def clearest(time: FloatArray, gain: FloatArray, beside: float) -> tuple[int, float]:
    """Row of the largest gain, and what it must exceed: the largest beside the two largest and what belongs to them."""
    rest = gain.copy()
    for _ in range(BEGIN_AND_END):
        rest[np.abs(time - time[np.argmax(rest)]) < beside] = 0.0
    return int(np.argmax(gain)), USUAL * float(rest.max())
