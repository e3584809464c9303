"""The track in local metres, with its fixes, outages, scale and north."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from insnav.earth import ned_offset
from insnav.errors.gps_gaps import in_outage, outages
from insnav.errors.metrics import distance_and_time
from insnav.report.colours import BLUE, GREY, ORANGE, VERMILLION
from insnav.report.map_drawing import finish_map, map_figure
from insnav.report.numbers import distance_text, duration_text
from insnav.types import BoolArray, FloatArray, GpsData, Run

POINTS = 20000


def draw_track(run: Run, gps: GpsData | None) -> Figure:
    """Draw the track seen from above.

    `gps`: the fixes, if there are any.
    """
    solution = run.solution
    stride = max(1, len(solution.time) // POINTS)
    time = solution.time[::stride]
    origin = solution.lla[0]
    north, east = ned_offset(solution.lla[::stride], origin)[:, :2].T
    spans = outages(run)
    lost = in_outage(time, spans)

    length, _ = distance_and_time(solution)
    lat, lon = np.degrees(origin[:2])
    fix = np.empty((0, 3)) if gps is None else ned_offset(gps.lla[:: max(1, len(gps.time) // POINTS)], origin)
    figure, axes = map_figure(
        _extremes(east, fix[:, 1]),
        _extremes(north, fix[:, 0]),
        f"Track of {distance_text(length)} in {duration_text(float(solution.time[-1] - solution.time[0]))}",
        f"start at latitude {lat:.5f}°, longitude {lon:.5f}°, height {origin[2]:.1f} m",
    )
    if len(fix):
        axes.plot(fix[:, 1], fix[:, 0], ".", color=GREY, markersize=3.0, label="GPS fix", zorder=1.8)
    axes.plot(east, north, color=BLUE, linewidth=1.4, label="solution", zorder=2.0)
    if lost.any():
        dark = np.where(lost, north, np.nan)
        total = sum(end - start for start, end in spans)
        axes.plot(east, dark, color=ORANGE, linewidth=3.0, label=f"no fix used ({total:.0f} s)", zorder=2.1)
    _rejected(axes, run, north, east, time)
    finish_map(axes, np.column_stack((north, east)))
    return figure


def _extremes(track: FloatArray, fixes: FloatArray) -> FloatArray:
    """Span the track and nearly all fixes: a few wild ones must not shrink the map."""
    most = np.percentile(fixes, [5.0, 95.0]) if len(fixes) else fixes
    return np.concatenate(([track.min(), track.max()], most))


def _rejected(axes: Axes, run: Run, north: FloatArray, east: FloatArray, time: FloatArray) -> None:
    """Mark the fixes whose position was refused where they were measured: solution plus innovation."""
    fixes = run.innovations
    refused: BoolArray = np.isfinite(fixes.innovation[:, :2]).all(axis=1) & ~fixes.used_position
    if not refused.any():
        return
    x = np.interp(fixes.time[refused], time, east) + fixes.innovation[refused, 1]
    y = np.interp(fixes.time[refused], time, north) + fixes.innovation[refused, 0]
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    outside = (x < left) | (x > right) | (y < low) | (y > high)
    label = (
        f"position rejected ({len(x)})"
        if not outside.any()
        else (f"position rejected ({len(x)}, {outside.sum()} beyond the edge)")
    )
    axes.plot(
        np.clip(x, left, right),
        np.clip(y, low, high),
        "x",
        color=VERMILLION,
        markersize=6.0,
        markeredgewidth=1.5,
        label=label,
        zorder=3,
        clip_on=False,
    )
