"""A lever arm that was given, and that the drive contradicts: turns and tilts show where the antenna is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.filter.navigate import feed
from insnav.filter.prepare import Prepared
from insnav.types import Event, EventKind

LOOK = 600.0  # so much of a drive tells it [s]
OPENED = 2.0  # standard deviation of each component in the pass that looks for it [m]
WRONG, SURE = 0.4, 6.0  # smallest error that is said [m], and in standard deviations of what was found


def lever_contradicted(ready: Prepared) -> tuple[Event, ...]:
    """Navigate the begin of a drive with the lever arm as a state; an event if it ends far from the one given."""
    given, begin = ready.settings.lever_b, ready.initial.time
    some = ready.imu.rows(slice(int(np.searchsorted(ready.imu.time, begin + LOOK))))
    settings = replace(ready.settings, lever_sd=OPENED, smooth=False)
    navigator = replace(ready, settings=settings).navigator()
    feed(navigator, some)
    run = navigator.finish()
    off = np.abs(run.lever_b - given)
    if not (off > np.maximum(WRONG, SURE * run.lever_sd)).any():
        return ()
    found, sd, arm = (",".join(f"{value + 0.0:.2f}" for value in each) for each in (run.lever_b, run.lever_sd, given))
    told = f"the antenna seems to be at {found} (± {sd}) m from the IMU, forward, right, down, not at {arm} as given"
    return (Event(begin, EventKind.CONTRADICTION, float(off.max()), WRONG, "m", f"{told}: --lever-arm {found}"),)
