"""Where fixes and IMU part for good, by so little at a time that no gate sees it: jumps, drags, steps of biases.

The adjoint of the smoother is the derivative of the log-likelihood of all later innovations by a change of the state,
and its matrix the information on that: the change that explains them best follows at every epoch, without another run
(P. de Jong, J. Penzer, "Diagnosing shocks in time series", J. Am. Stat. Assoc. 93 (1998) 796-806). Beside position,
velocity and biases a state is looked at that the filter lacks: a minute of drift that velocities do not know.
What would not be seen follows from the same information (minimal detectable bias: W. Baarda, "A testing procedure for
use in geodetic networks", Netherlands Geodetic Commission 2/5 (1968)).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from insnav.filter.smoother import SmoothedErrors
from insnav.plain_text import moment
from insnav.types import BoolArray, Event, EventKind, FloatArray
from insnav.units import DEG


class Change(NamedTuple):
    """How a kind of change is said, and from where on."""

    told: str
    unit: str
    # twice the gain of the log-likelihood, chi-square with three degrees of freedom: of a true model once in 10^7
    # epochs; recorded drives without a fault have up to 28 in drifts, 50 in biases [-]
    limit: float
    beside: float  # so near a change shows, too; drifts fill many of the few minutes [s]
    least: float = 0.0  # in the unit; biases of good sensors change by less


CHANGES = (
    Change("fixes jump by {} at {} and stay there, against IMU and all others: either may be wrong", "m", 35.0, 20.0),
    Change("the velocity of the fixes changes by {} at {} without the IMU: false fixes or samples", "m/s", 35.0, 20.0),
    Change("positions drift by {} or more in the minute from {} on, unlike the velocities", "m/s", 35.0, np.inf),
    Change("the gyro bias changes by {} at {} and stays so, against all fixes", "deg/s", 60.0, 120.0, 0.02),
    Change("the accelerometer bias changes by {} at {} and stays so, against all fixes", "m/s^2", 60.0, 120.0, 0.02),
)
DRIFT = 2  # beside velocities
OF_FIXES = 3  # the first of them: the smallest that would be seen is stated
USUAL = 4.0  # times what the drive shows a third time: recorded ones have more than the model has
BEGIN_AND_END = 2  # a drag has both
AT_REST = 1.0  # [m/s]
# so long after a start at rest, after one in motion, before and after a departure the attitude is not yet that of a
# linear model: a departure tells heading and misalignments at once [s]
START, IN_MOTION, BEFORE, AFTER = 10.0, 60.0, 10.0, 20.0
NEARLY_ALL = 0.9  # of the epochs see what is stated as seen
NINE_IN_TEN = 1.28  # standard deviations by which a change must exceed the limit to be seen nine times in ten


def shock(found: SmoothedErrors, *, velocities: bool = True) -> tuple[list[Event], FloatArray]:
    """Event of the change that stands out most, if one does, and the smallest changes that would have been seen.

    These are a jump of the position [m], a change of velocity and a minute of drift [m/s], (3,), each seen nine times
    in ten in all but a tenth of the record. Without GPS `velocities` there is nothing a drift is beside of.
    """
    rows = settled(found)
    time, smallest = found.time[rows], np.full(OF_FIXES, np.inf)
    worst, events = 1.0, list[Event]()
    for group, (told, unit, limit, beside, least) in enumerate(CHANGES):
        gain, size, sd = found.shocks[rows, 3 * group : 3 * group + 3].T
        if not np.isfinite(gain).any() or (group == DRIFT and not velocities):
            continue
        gain = np.nan_to_num(gain)
        row, usual = clearest(time, gain, beside)
        seen = max(limit, usual)
        value = float(size[row]) / (DEG if unit == "deg/s" else 1.0)
        if group < OF_FIXES:
            excess = np.sqrt(seen / limit)  # of what the drive shows over what the model has
            smallest[group] = (np.sqrt(seen) + NINE_IN_TEN * excess) * np.nanquantile(sd, NEARLY_ALL)
        if gain[row] > worst * seen and value > least:
            worst, at = float(gain[row]) / seen, float(time[row])
            said = told.format(f"{value:.2g} {unit}", moment(at))
            events = [Event(at, EventKind.CONTRADICTION, value, float("nan"), unit, said)]
    return events, smallest


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
