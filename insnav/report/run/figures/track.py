"""The track in local metres, with its fixes, outages, scale and north."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from insnav.earth import ned_offset
from insnav.errors.gps_gaps import in_outage, outages
from insnav.errors.metrics import distance_and_time
from insnav.report.style import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILLION, blank
from insnav.types import BoolArray, FloatArray, GpsData, Run

POINTS = 20000
_NARROWEST_M = 4.0  # a vehicle at rest needs a map too
_WIDTH = 7.35  # of the map [inch]


def draw_track(run: Run, gps: GpsData | None) -> Figure:
    """Draw the track seen from above.

    Parameters
    ----------
    run : Run
    gps : GpsData or None
        The fixes, if there are any.
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
    x_limits, y_limits = map_limits(_extremes(east, fix[:, 1]), _extremes(north, fix[:, 0]))
    height = _WIDTH * (y_limits[1] - y_limits[0]) / (x_limits[1] - x_limits[0])
    figure = blank(
        _WIDTH + 1.05,
        height + 1.85,
        f"Track of {distance_text(length)} in {duration_text(float(solution.time[-1] - solution.time[0]))}",
        f"start at latitude {lat:.5f}°, longitude {lon:.5f}°, height {origin[2]:.1f} m",
    )
    figure.subplots_adjust(bottom=0.95 / (height + 1.85))
    axes = figure.subplots()
    axes.set_xlim(*x_limits)
    axes.set_ylim(*y_limits)
    if len(fix):
        axes.plot(fix[:, 1], fix[:, 0], ".", color=GREY, markersize=3.0, label="GPS fix", zorder=1.8)
    axes.plot(east, north, color=BLUE, linewidth=1.4, label="solution", zorder=2.0)
    if lost.any():
        dark = np.where(lost, north, np.nan)
        total = sum(end - start for start, end in spans)
        axes.plot(east, dark, color=ORANGE, linewidth=3.0, label=f"no fix used ({total:.0f} s)", zorder=2.1)
    _rejected(axes, run, north, east, time)
    # many a drive ends where it began: the start is the larger mark, so that both are seen
    axes.plot(east[0], north[0], "^", color=GREEN, markersize=13.0, markeredgecolor="white", label="start", zorder=4)
    axes.plot(east[-1], north[-1], "s", color=BLACK, markersize=5.0, markeredgecolor="white", label="end", zorder=4)
    scale_bar(axes)
    north_arrow(axes)
    axes.set_aspect("equal")
    axes.set_xlabel("East of start [m]")
    axes.set_ylabel("North of start [m]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.45 / height), ncols=6, handlelength=1.4, columnspacing=1.2)
    return figure


def _extremes(track: FloatArray, fixes: FloatArray) -> FloatArray:
    """Span the track and nearly all fixes: a few wild ones must not shrink the map."""
    most = np.percentile(fixes, [5.0, 95.0]) if len(fixes) else fixes
    return np.concatenate(([track.min(), track.max()], most))


def map_limits(east: FloatArray, north: FloatArray) -> tuple[tuple[float, float], tuple[float, float]]:
    """Limits east and north: the track and a margin, no narrower than fits a page."""
    width, height = (max(float(np.ptp(v)), _NARROWEST_M) for v in (east, north))
    margin = 0.07 * max(width, height)
    width, height = width + 2.0 * margin, height + 2.0 * margin
    half_east, half_north = 0.5 * max(width, 0.95 * height), 0.5 * max(height, 0.4 * width)
    middle_east, middle_north = (0.5 * (float(v.min()) + float(v.max())) for v in (east, north))
    return (
        (middle_east - half_east, middle_east + half_east),
        (middle_north - half_north, middle_north + half_north),
    )


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


def scale_bar(axes: Axes) -> None:
    """Draw a bar of a round length, about a fifth of the width, in the lower left corner."""
    (left, right), (low, _) = axes.get_xlim(), axes.get_ylim()
    longest = 0.25 * (right - left)
    power = 10.0 ** np.floor(np.log10(longest))
    length = float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest))
    x, y = left + 0.04 * (right - left), low + 0.03 * (right - left)
    tick = 0.008 * (right - left)
    axes.plot(
        [x, x, x, x + length, x + length, x + length],
        [y + tick, y - tick, y, y, y + tick, y - tick],
        color=BLACK,
        linewidth=1.6,
        zorder=5,
    )
    axes.text(x + 0.5 * length, y + 1.3 * tick, distance_text(length), ha="center", va="bottom", fontsize=8.5)


def north_arrow(axes: Axes) -> None:
    """Mark north in the upper right corner."""
    axes.annotate(
        "N",
        xy=(0.965, 0.985),
        xytext=(0.0, -42.0),
        xycoords="axes fraction",
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=11.0,
        fontweight="bold",
        arrowprops={"arrowstyle": "-|>", "color": BLACK, "linewidth": 1.6},
    )


def distance_text(length_m: float) -> str:
    """Length in metres or kilometres."""
    return f"{length_m / 1000.0:.3g} km" if length_m >= 1000.0 else f"{length_m:.3g} m"


def duration_text(seconds: float) -> str:
    """Time in seconds or minutes."""
    return f"{seconds / 60.0:.1f} min" if seconds >= 120.0 else f"{seconds:.1f} s"
