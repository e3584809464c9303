"""An ensemble of runs: errors, the standard deviations that the filter stated, and whether the two agree."""

from __future__ import annotations

import numpy as np

from insnav.errors.ensemble import BAND, GROUPS, Ensemble, band, inside
from insnav.report.colours import AXIS_COLOURS, BLUE, GREY, VERMILLION
from insnav.report.panels import Curve, Panel
from insnav.report.series import Clock, broken_at_gaps
from insnav.types import FloatArray

_COMPONENTS = (
    *((f"{axis} position", "m") for axis in ("north", "east", "down")),
    *((f"{axis} velocity", "m/s") for axis in ("north", "east", "down")),
    *((axis, "deg") for axis in ("roll", "pitch", "heading")),
)


def ensemble_panels(found: Ensemble) -> tuple[Panel, ...]:
    """Draw root mean square error and stated standard deviation of all nine components over time, axis by axis."""
    clock = Clock.of(found.time)
    low, high = (np.sqrt(limit)[:, None] for limit in band(found.count))
    time, columns = broken_at_gaps(
        clock(found.time), np.column_stack((found.rms, found.sd, low * found.sd, high * found.sd))
    )
    panels = []
    note = f"{100 * BAND:.0f} % of the RMS errors lie in the band if the filter is right"
    for column in (3 * group + axis for axis in range(3) for group in range(3)):
        name, unit = _COMPONENTS[column]
        size = 180.0 / np.pi if unit == "deg" else 1.0
        error, sd, least, most = (size * columns[:, 9 * part + column] for part in range(4))
        curves = (
            Curve(f"{100 * BAND:.0f} % band", time, most, BLUE, "band", least),
            Curve("stated sd", time, sd, BLUE),
            Curve("RMS error", time, error, VERMILLION),
        )
        # by the stated sd: at rest before the start an error may be as good as none
        limits = 0.5 * float(np.nanmin(least)), 1.5 * float(max(np.nanmax(most), np.nanmax(error)))
        key, title, label = f"ensemble_{name.replace(' ', '_')}", name.capitalize(), f"error [{unit}]"
        panels.append(Panel(key, title, label, clock.label, curves, "time", note, log_y=True, limits=limits))
        note = ""
    return tuple(panels)


def nees_panels(found: Ensemble) -> tuple[Panel, ...]:
    """Draw the mean normalised error squared of position, velocity and attitude over time."""
    clock = Clock.of(found.nees_time)
    low, high = band(3 * found.nees_count)
    share = inside(found).mean(axis=0)
    time, columns = broken_at_gaps(clock(found.nees_time), np.column_stack((found.nees, low, high)))
    panels = []
    for row, (name, colour) in enumerate(zip(GROUPS, AXIS_COLOURS, strict=True)):
        curves = (
            Curve(f"{100 * BAND:.0f} % of a consistent filter", time, columns[:, 4], GREY, "band", columns[:, 3]),
            Curve("mean of the runs and axes", time, columns[:, row], colour),
        )
        title = f"Normalised error squared of {name}: {100.0 * share[row]:.0f} % of the fixes inside"
        note, limits = "" if row else "1 if the stated covariance is right", (0.0, _top(columns[:, row], columns[:, 4]))
        panels.append(Panel(f"nees_{name}", title, "NEES / 3 [-]", clock.label, curves, "time", note, limits=limits))
    return tuple(panels)


def _top(value: FloatArray, limit: FloatArray) -> float:
    """Upper end of the axis: nearly all values, and the band."""
    known = value[np.isfinite(value)]
    return 1.1 * max(float(np.percentile(known, 99.5)) if known.size else 1.0, float(np.nanmax(limit)))
