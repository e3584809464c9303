"""Where fixes and IMU part for good, by so little at a time that no gate sees it: jumps, and fixes dragged off.

The adjoint of the smoother is the derivative of the log-likelihood of all later innovations by a change of the state,
and its matrix the information on that: the change that explains them best follows at every epoch, without another run
(P. de Jong, J. Penzer, "Diagnosing shocks in time series", J. Am. Stat. Assoc. 93 (1998) 796-806). Beside position and
velocity a state is looked at that the filter lacks: a minute of drift of the positions that velocities do not know.
What would not be seen follows from the same information (minimal detectable bias: W. Baarda, "A testing procedure for
use in geodetic networks", Netherlands Geodetic Commission 2/5 (1968)).
"""

from __future__ import annotations

import numpy as np

from insnav.filter.smoother import SmoothedErrors
from insnav.types import Event, EventKind, FloatArray

# twice the gain of the log-likelihood from which a change is said, chi-square with three degrees of freedom: of a true
# model once in 10^7 epochs, and once in 10^5 minutes [-]
LIMITS = 35.0, 35.0, 26.0
USUAL = 4.0  # times what the drive shows a third time: recorded ones have more than the model has
BEGIN_AND_END = 2  # a drag has both
BESIDE = 20.0  # so near a change shows, too [s]
SETTLING = 60.0  # after the start the attitude is not yet that of a linear model [s]
NEARLY_ALL = 0.9  # of the epochs see what is stated as seen
NINE_IN_TEN = 1.28  # standard deviations by which a change must exceed the limit to be seen nine times in ten
UNITS = "m", "m/s", "m/s"
TOLD = (
    "fixes jump by {:.2g} m at {:.1f} s, against the IMU and all other fixes, and stay there: either side may be wrong",
    "the velocity of the fixes changes by {:.2g} m/s at {:.1f} s without the IMU: dragged fixes, "
    "false velocities or false samples",
    "the positions drift by {:.2g} m/s in the minute from {:.1f} s on, against GPS velocities and IMU: dragged fixes, "
    "or false velocities",
)


def shock(found: SmoothedErrors, *, velocities: bool = True) -> tuple[list[Event], FloatArray]:
    """Event of the change that stands out most, if one does, and the smallest changes that would have been seen.

    These are a jump of the position [m], a change of velocity and a minute of drift [m/s], (3,), each seen nine times
    in ten in all but a tenth of the record. Without GPS `velocities` there is nothing a drift is beside of.
    """
    rows = found.time > found.time[0] + SETTLING
    time, smallest = found.time[rows], np.full(3, np.inf)
    worst, events = 1.0, list[Event]()
    for group, limit in enumerate(LIMITS if velocities else LIMITS[:2]):
        gain, size, sd = found.shocks[rows, 3 * group : 3 * group + 3].T
        if not np.isfinite(gain).any():
            continue
        gain = np.nan_to_num(gain)
        row = int(np.argmax(gain))
        if group < 2:  # a drag fills many of the few minutes
            limit = max(limit, USUAL * _third(time, gain))
        excess = np.sqrt(limit / LIMITS[group])  # of what the drive shows over what the model has
        smallest[group] = (np.sqrt(limit) + NINE_IN_TEN * excess) * np.nanquantile(sd, NEARLY_ALL)
        if gain[row] > worst * limit:
            worst, at = float(gain[row]) / limit, float(time[row])
            told = TOLD[group].format(size[row], at)
            events = [Event(at, EventKind.CONTRADICTION, float(size[row]), float("nan"), UNITS[group], told)]
    return events, smallest


def _third(time: FloatArray, gain: FloatArray) -> float:
    """Largest gain beside the two largest and what belongs to them."""
    rest = gain.copy()
    for _ in range(BEGIN_AND_END):
        rest[np.abs(time - time[np.argmax(rest)]) < BESIDE] = 0.0
    return float(rest.max())
