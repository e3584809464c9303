"""Image files of reports with matplotlib: style, axes, legends, files; panels and maps as on the HTML page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from insnav.messages import speaking
from insnav.report import style as styles
from insnav.report.panels import Curve, Drawing, Panel, Track, envelope, limits_of, modes, thinned
from insnav.types import FloatArray

DOTS_PER_INCH = 130
_LONG = 1e4  # a logarithmic axis with at least this ratio of its limits is labelled at powers of ten only
_RC: Any = mpl.rc_params_from_file(Path(__file__).with_name("papers.mplstyle"), use_default_template=False)
_NARROWEST_M = 4.0  # smallest width of a map on the ground, needed for a stationary vehicle
_WIDTH = 7.35  # width of the map [inch]
_PIXELS = 108.0  # converts the height of a panel on the page to its height in an image file [px/inch]
_BESIDE = 62  # number of characters of title and legend that fit on one line above a full-width panel
_STYLES: dict[str, dict[str, Any]] = {
    "line": {"linewidth": 1.3},
    "dashed": {"linewidth": 1.2, "linestyle": "--"},
    "thin": {"linewidth": 0.5, "alpha": 0.5},
    "points": {"linestyle": "", "marker": ".", "markersize": 5.0},
    "crosses": {"linestyle": "", "marker": "x", "markersize": 5.0},
}
_FEW = 0.05  # up to this share of its values, a curve's values beyond the axis limits are marked at the edge
_WHERE_FEW = 40  # up to this number of points, the points are drawn large


@contextmanager
def drawing() -> Iterator[None]:
    """Set the style of all figures drawn inside this context, and English, since the font lacks other scripts."""
    with mpl.rc_context(_RC), speaking("en"):
        yield


def blank(width: float, height: float, title: str, note: str) -> Figure:
    """Create a figure of some size [inch] without axes, with headline, explanatory note and margins."""
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    # The margins are fixed: to measure them, matplotlib would have to draw the whole figure twice.
    figure.subplots_adjust(left=0.85 / width, right=1.0 - 0.2 / width, bottom=0.55 / height, top=1.0 - 0.85 / height)
    left = 0.15 / width
    figure.text(left, 1.0 - 0.12 / height, title, ha="left", va="top", fontsize=11.5, fontweight="bold")
    figure.text(left, 1.0 - 0.36 / height, note, ha="left", va="top", fontsize=8.5, color="#444444")
    return figure


def save(figure: Figure, path: Path, file_format: Literal["png", "svg"]) -> Path:
    """Write a figure to a file and return its path. `path`: without suffix."""
    file = path.with_name(f"{path.name}.{file_format}")
    if file_format == "svg":
        figure.savefig(file, metadata={"Date": None, "Creator": None})
    else:
        # Low compression takes half the time of the default and makes files only a fifth larger.
        figure.savefig(file, dpi=DOTS_PER_INCH, metadata={"Software": None}, pil_kwargs={"compress_level": 3})
    return file


def logarithmic(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers: 1, 2 and 5 times powers of ten, on long axes powers only."""
    low, high = sorted(axis.get_view_interval())
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < _LONG * low else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def legend_above(axes: Axes, lift: float) -> None:
    """Place the legend on one line above the right corner of a panel. `lift`: height of its edge [panel heights]."""
    entries: dict[str, Any] = {}
    for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
        entries.setdefault(label, handle)
    if entries:
        axes.legend(
            handles=list(entries.values()),
            labels=list(entries),
            loc="lower right",
            bbox_to_anchor=(1.0, lift),
            ncols=len(entries),
            borderaxespad=0.1,
            handlelength=1.4,
            columnspacing=1.2,
        )


def draw_drawings(drawings: Sequence[Drawing], title: str, note: str = "", *, columns: int = 1) -> Figure:
    """Draw a map, or a grid of panels with `columns` columns, as one figure."""
    if isinstance(drawings[0], Track):
        return _draw_track(drawings[0], title, note)
    panels = [each for each in drawings if isinstance(each, Panel)]
    rows = -(-len(panels) // columns)
    sizes = [max(each.height for each in panels[columns * i : columns * (i + 1)]) / _PIXELS for i in range(rows)]
    shared = len({(each.link, each.x_label) for each in panels}) == 1 and bool(panels[0].link)
    figure = blank(8.4 if columns == 1 else 11.4, 1.5 + sum(sizes) + (0.0 if shared else 0.4 * (rows - 1)), title, note)
    grid = {"hspace": 0.3 if shared else 0.55, "wspace": 0.26, "height_ratios": sizes}
    axes_grid = figure.subplots(rows, columns, squeeze=False, sharex="col" if shared else "none", gridspec_kw=grid)
    if any(each.rows for each in panels):
        longest = max(len(name) for each in panels for name in each.rows)
        figure.subplots_adjust(left=min(0.6, (0.3 + 0.075 * longest) / figure.get_figwidth()))
    mode = next(iter(modes(panels)), "")
    for i, axes in enumerate(axes_grid.flat):
        if i >= len(panels):
            axes.set_axis_off()
            continue
        draw_panel(axes, panels[i], mode, heading=len(panels) > 1, letters=_BESIDE // columns)
        if not shared or i + columns >= len(panels):
            axes.set_xlabel(panels[i].x_label)
            axes.tick_params(labelbottom=True)
    return figure


def draw_panel(axes: Axes, panel: Panel, mode: str = "", *, heading: bool = True, letters: int = _BESIDE) -> None:
    """Draw a panel with the curves of one mode. `letters`: characters that fit on a line with title and legend."""
    low, high = (-0.6, len(panel.rows) - 0.4) if panel.rows else limits_of(panel, mode) or (0.0, 1.0)
    axes.set_xscale("log" if "x" in panel.log else "linear")
    axes.set_yscale("log" if "y" in panel.log else "linear")
    for start, end in panel.spans:
        axes.axvspan(start, end, color=styles.ORANGE, alpha=0.18, linewidth=0.0, zorder=0.5)
    for curve in panel.curves:
        if curve.mode in ("", mode) and len(curve.x):
            _draw_curve(axes, curve, low, high)
    for value, name in panel.levels:
        axes.axhline(value, color=styles.VERMILLION, linewidth=1.0, linestyle="--", label=name)
    if panel.rows:
        axes.set_yticks(range(len(panel.rows)), panel.rows)
        low, high = high, low  # the first row is at the top
    axes.set_ylim(low, high)
    for name in panel.log:
        logarithmic(axes.xaxis if name == "x" else axes.yaxis)
    if panel.ticks:
        axes.set_xticks([position for position, _ in panel.ticks], [name for _, name in panel.ticks])
    axes.set_ylabel(panel.y_label)
    handles, labels = axes.get_legend_handles_labels()
    entries = dict(zip(reversed(labels), reversed(handles), strict=True))
    if heading:
        axes.set_title(panel.title)
    length = sum(len(each) + 5 for each in entries)
    if length > 2.4 * letters:
        kept = list(entries)[::-1]
        axes.legend(
            [entries[each] for each in kept],
            kept,
            loc="lower left" if panel.rows else "upper left",
            fontsize=7.0,
            handlelength=1.4,
        )
    elif len(entries) > 1 or (entries and panel.levels):
        beside = len(panel.title) * heading + length < 2.0 * letters
        legend_above(axes, 1.0 if beside else 1.0 + 21.6 / panel.height)


def _draw_curve(axes: Axes, curve: Curve, low: float, high: float) -> None:
    """Draw a curve; triangles at the edge of the panel mark values beyond the axis limits, if these are few."""
    if curve.kind == "band" and curve.low is not None:
        x, bottom, top = envelope(curve.x, curve.low, curve.y)
        axes.fill_between(x, bottom, top, color=curve.colour, alpha=0.2, linewidth=0.0, label=curve.name or "_")
        return
    if curve.kind == "bars" and curve.low is not None:
        axes.barh(curve.y, curve.x - curve.low, 0.7, curve.low, color=curve.colour, label=curve.name or "_")
        return
    style = _STYLES[curve.kind]
    if curve.kind == "points" and len(curve.x) <= _WHERE_FEW:
        style = style | {"marker": "o", "markersize": 4.0}
    axes.plot(*thinned(curve.x, curve.y), color=curve.colour, label=curve.name or "_", **style)
    if curve.kind == "thin" and curve.text:
        axes.annotate(curve.text[0], (curve.x[0], curve.y[0]), fontsize=7, color=curve.colour, ha="right", va="center")
    if curve.kind == "thin":
        return
    for beyond, edge, marker in ((curve.y > high, high, "^"), (curve.y < low, low, "v")):
        if beyond.any() and (curve.kind == "crosses" or np.count_nonzero(beyond) <= max(3, _FEW * len(beyond))):
            out = curve.x[beyond]
            axes.plot(
                out, np.full(len(out), edge), marker, color=curve.colour, markersize=5.0, clip_on=False, label="beyond"
            )


def _draw_track(track: Track, title: str, note: str) -> Figure:
    """Draw a map whose track is coloured by its first shade; crosses outside the map are drawn at its edge."""
    other_tracks = [np.column_stack((each.x, each.y)) for each in track.behind if each.kind in ("line", "dashed")]
    fixes = np.empty((0, 2)) if track.fixes is None else track.fixes
    # the map contains only the middle 90 % of the fixes: a distant false fix would shrink the track
    most = [np.percentile(fixes, (5.0, 95.0), axis=0)] if len(fixes) else []
    extent = np.concatenate([np.column_stack((track.east, track.north)), *other_tracks, *most])
    shade = track.shades[0] if track.shades and not track.shades[0].classes else None
    figure, axes = _start_map(extent, title, note, 0.85 if shade else 0.0)
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    axes.plot(*fixes.T, ".", color=styles.GREY, markersize=3.0, label="GPS fix" if len(fixes) else "_", zorder=1.8)
    for curve in track.behind:
        if curve.kind == "crosses":
            x, y = np.clip(curve.x, left, right), np.clip(curve.y, low, high)
            beyond = int(np.count_nonzero((x != curve.x) | (y != curve.y)))
            name = f"{curve.name[:-1]}, {beyond} beyond the edge)" if beyond else curve.name
            axes.plot(x, y, "x", color=curve.colour, markersize=6.0, label=name, zorder=3, clip_on=False)
        else:
            width = 0.8 if curve.kind == "thin" else 2.6
            axes.plot(curve.x, curve.y, color=curve.colour, label=curve.name or "_", linewidth=width, zorder=1.7)
    in_outage = np.zeros(len(track.time), dtype=np.bool_)
    for start, end in track.spans:
        in_outage |= (track.time >= start) & (track.time <= end)
    if in_outage.any():
        north = np.where(in_outage, track.north, np.nan)
        axes.plot(track.east, north, color=styles.ORANGE, linewidth=7.0, alpha=0.4, label="no fix used", zorder=1.9)
    if shade is None:
        axes.plot(track.east, track.north, color=styles.BLUE, linewidth=1.4, label="solution")
    else:
        pieces = _pieces(track, shade.values)
        axes.add_collection(pieces)
        figure.colorbar(pieces, ax=axes, label=shade.name, fraction=0.05, pad=0.02)
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    _finish_map(axes, track)
    return figure


def _pieces(track: Track, values: FloatArray) -> LineCollection:
    """Split a track of n points into n - 1 line segments, coloured by the mean of `values` (n,) at both ends."""
    points = np.column_stack((track.east, track.north))
    pieces = LineCollection(
        list(np.stack((points[:-1], points[1:]), axis=1)), cmap="cividis", linewidth=2.2, capstyle="round", zorder=2
    )
    pieces.set_array(0.5 * (values[:-1] + values[1:]))
    return pieces


def _start_map(points: FloatArray, title: str, note: str, beside: float) -> tuple[Figure, Axes]:
    """Create a map that contains points East, North (n, 2) [m]. `beside`: space for a colour bar, to the right [in]."""
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = (max(float(size), _NARROWEST_M) for size in high - low)
    margin = 0.07 * max(width, height)
    width, height = width + 2.0 * margin, height + 2.0 * margin
    half, middle = (0.5 * max(width, 0.95 * height), 0.5 * max(height, 0.4 * width)), 0.5 * (low + high)
    x_limits, y_limits = ((float(at) - size, float(at) + size) for at, size in zip(middle, half, strict=True))
    height = _WIDTH * (y_limits[1] - y_limits[0]) / (x_limits[1] - x_limits[0])
    width = _WIDTH + 1.05 + beside
    figure = blank(width, height + 1.85, title, note)
    figure.subplots_adjust(bottom=0.95 / (height + 1.85), right=1.0 - (0.2 + beside) / width)
    return figure, figure.subplots(subplot_kw={"xlim": x_limits, "ylim": y_limits})


def _finish_map(axes: Axes, track: Track) -> None:
    """Add to a map: marks at start and end of the track, scale bar, north arrow, axis labels, legend below."""
    # The start mark is larger than the end mark: both stay visible if a drive ends at its start.
    for row, marker, colour, size, name in ((0, "^", styles.GREEN, 13.0, "start"), (-1, "s", styles.BLACK, 5.0, "end")):
        place = track.east[row], track.north[row]
        axes.plot(*place, marker, color=colour, markersize=size, markeredgecolor="white", label=name, zorder=4)
    scale_bar(axes)
    north_arrow(axes)
    axes.set_aspect("equal")
    axes.set_xlabel("East of start [m]")
    axes.set_ylabel("North of start [m]")
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    below = -0.45 / (_WIDTH * (high - low) / (right - left))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, below), ncols=6, handlelength=1.4, columnspacing=1.2)


def scale_bar(axes: Axes) -> None:
    """Draw a scale bar in the lower left corner: 1, 2 or 5 times a power of ten, up to a quarter of the map width."""
    (left, right), (low, _) = axes.get_xlim(), axes.get_ylim()
    longest = 0.25 * (right - left)
    power = 10.0 ** np.floor(np.log10(longest))
    length = float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest))
    x, y = left + 0.04 * (right - left), low + 0.03 * (right - left)
    tick = 0.008 * (right - left)
    across, along = [x] * 3 + [x + length] * 3, [y + tick, y - tick, y, y, y + tick, y - tick]
    axes.plot(across, along, color=styles.BLACK, linewidth=1.6, zorder=5)
    axes.text(x + 0.5 * length, y + 1.3 * tick, styles.distance_text(length), ha="center", va="bottom", fontsize=8.5)


def north_arrow(axes: Axes) -> None:
    """Draw an arrow to the north in the upper right corner of a map."""
    place: dict[str, Any] = {"xytext": (0.0, -42.0), "xycoords": "axes fraction", "textcoords": "offset points"}
    place |= {"ha": "center", "va": "center", "fontsize": 11.0, "fontweight": "bold"}
    arrow = {"arrowstyle": "-|>", "color": styles.BLACK, "linewidth": 1.6}
    axes.annotate("N", (0.965, 0.985), **place, arrowprops=arrow)
