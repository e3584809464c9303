"""Interactive drawings of a page, and preparation of their data: time axes, thinning, robust axis limits.

``templates/panels.js`` draws them with BokehJS in the browser. Panels and maps with equal `Panel.link` share a cursor;
such panels also share their horizontal axis.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from insnav.findings import Finding
from insnav.messages import form, sentence
from insnav.plain_text import plain_text
from insnav.types import FloatArray

BINS = 1200  # intervals of a thinned line in image files: about one per pixel, which is the visible resolution
_TAIL = 0.5  # share of the values that robust axis limits may cut off at either end [%]
_WORTH = 1.5  # axis limits show all values if their range is below this multiple of the robust range
LEAST_ERROR = 1e-4  # smallest error in error distributions, as their axes are logarithmic [m]
LINE_BINS = 1000  # intervals of a thinned line on the page; the smallest and largest value of each are kept
BAND_BINS = 500  # intervals of a thinned band on the page
MARKERS = 2000  # largest number of points of a cloud on the page, including its extremes
Kind = Literal["line", "dashed", "thin", "points", "crosses", "band", "bars"]


@dataclass(frozen=True, slots=True)
class Clock:
    """Time axis of one run: seconds, minutes or hours since its start."""

    start: float  # origin of the axis, in the time of the data [s]
    unit_s: float  # unit of the axis [s]
    unit: str
    label: str  # axis label

    @classmethod
    def of(cls, time: FloatArray) -> Clock:
        """Choose origin and unit of the axis from all times of a run ``(n,)`` [s]."""
        start = float(time[0]) if len(time) else 0.0
        length = float(time[-1]) - start if len(time) else 0.0
        unit_s, unit = (3600.0, "h") if length > 6 * 3600.0 else (60.0, "min") if length > 900.0 else (1.0, "s")
        since = f" since {start:.1f} s" if start else ""
        return cls(start, unit_s, unit, f"time{since} [{unit}]")

    def __call__(self, time: Any) -> Any:
        """Convert times of the data [s] to axis positions."""
        return (np.asarray(time) - self.start) / self.unit_s

    def moment(self, begin: float, end: float) -> str:
        """Write a time of the data, or an interval [s], in axis units, with words for times before the origin."""
        form_of, times = {"s": ".1f", "min": ".2f", "h": ".4f"}[self.unit], dict.fromkeys((begin, end))
        first, *rest = (format(self(abs(time - self.start) + self.start), form_of) for time in times)
        until, before = f" {form('until')} ", form("before_start")
        if begin >= self.start:
            return f"{until.join((first, *rest))} {self.unit}"
        if end < self.start:
            return before.format(f"{until.join((first, *rest))} {self.unit}")
        return f"{before.format(f'{first} {self.unit}')}{until}{rest[0]} {self.unit}"

    def sentence(self, finding: Finding) -> str:
        """Write a finding as a sentence, with times in axis units."""
        return sentence(finding, at=self.moment)


def envelope(
    time: FloatArray, low: FloatArray, high: FloatArray, bins: int = BINS
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Thin a band ``(n,)`` to at most `bins` points by the extremes of its edges in intervals; NaN breaks remain."""
    if len(time) <= bins:
        return time, low, high
    starts = np.linspace(0, len(time), bins + 1).astype(np.int64)[:-1]
    return time[starts], np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)


def thinned(time: FloatArray, value: FloatArray, bins: int = BINS) -> tuple[FloatArray, FloatArray]:
    """Thin a line ``(n,)`` to the smallest and the largest value in each of `bins` intervals; NaN breaks remain."""
    if len(time) <= 2 * bins:
        return time, value
    length = -(-len(time) // bins)
    padding = -len(time) % length
    blocks = np.concatenate((value, np.full(padding, value[-1]))).reshape(-1, length)
    is_break = np.isnan(blocks)
    low = np.argmin(np.where(is_break, np.inf, blocks), axis=1)
    high = np.argmax(np.where(is_break, -np.inf, blocks), axis=1)
    gap = np.where(is_break.any(axis=1), np.argmax(is_break, axis=1), low)  # first NaN of each block, if there is one
    first = np.arange(len(blocks)) * length
    rows = np.unique(np.concatenate((first + low, first + high, first + gap, [len(time) - 1])))
    rows = rows[rows < len(time)]
    return time[rows], value[rows]


def broken_at_gaps(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Insert a row of NaN into values ``(n, k)`` at every time gap above 5 median intervals, to interrupt the line."""
    if len(time) < 3:
        return time, values
    step = np.diff(time)
    after = np.flatnonzero(step > 5.0 * np.median(step)) + 1
    if not after.size:
        return time, values
    return np.insert(time, after, time[after]), np.insert(values, after, np.nan, axis=0)


def robust_limits(values: Iterable[FloatArray], least: float = 0.0) -> tuple[float, float] | None:
    """Compute axis limits that a few outliers do not widen; None without finite values.

    `values`: arrays (n,) of any lengths; the limits include most of every array. `least`: smallest axis range.
    """
    finite = [each[np.isfinite(each)] for each in values]
    finite = [each for each in finite if each.size]
    if not finite:
        return None
    low, high = min(float(each.min()) for each in finite), max(float(each.max()) for each in finite)
    percentiles = [np.percentile(each, (_TAIL, 100.0 - _TAIL)) for each in finite]
    robust = min(float(a) for a, _ in percentiles), max(float(b) for _, b in percentiles)
    if high - low > _WORTH * (robust[1] - robust[0]) > 0.0:
        low, high = robust
    margin = 0.06 * (high - low)
    half = max(0.5 * (high - low) + margin, 0.5 * least, 1e-12 * max(abs(low), abs(high)), 1e-12)
    return 0.5 * (low + high) - half, 0.5 * (low + high) + half


def wrapped(heading: FloatArray) -> FloatArray:
    """Wrap headings (n,) [deg] to 0..360, with NaN where they pass north, so that a line is interrupted there."""
    angle = heading % 360.0
    angle[1:][np.abs(np.diff(angle)) > 180.0] = np.nan
    return angle


@dataclass(frozen=True, slots=True)
class Curve:
    """Line, band, cloud of points or set of bars. Curves of one name share a legend entry."""

    name: str  # legend entry; empty: no entry
    x: FloatArray  # (n,) horizontal positions; of bars: their right ends
    y: FloatArray  # (n,) vertical positions; of a band: its upper edge; of bars: row numbers, 0 at the top
    colour: str  # "#RRGGBB", from `insnav.report.style`; the page lightens it in its dark theme
    kind: Kind = "line"
    low: FloatArray | None = None  # (n,) lower edge of a band, or left ends of bars
    mode: str = ""  # position of the page's switch that shows the curve, such as "filtered"; empty: any position
    # text on hover for points and bars, label at the start of a thin line, name written on another line
    text: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Panel:
    """Curves over one horizontal axis."""

    key: str  # id of the panel in the page
    title: str
    y_label: str  # including the unit: ``error [m]``
    x_label: str
    curves: tuple[Curve, ...]
    link: str = ""  # panels with equal nonempty link share their horizontal axis and cursor
    note: str = ""  # explanation
    log: Literal["", "x", "y", "xy"] = ""  # logarithmic axes
    limits: tuple[float, float] | None = None  # limits of the vertical axis; None: from the curves, without outliers
    least: float = 0.0  # smallest range of the vertical axis, so that rounding errors of a constant are not magnified
    levels: tuple[tuple[float, str], ...] = ()  # value and name of horizontal lines, such as gates
    spans: tuple[tuple[float, float], ...] = ()  # shaded intervals of the horizontal axis
    rows: tuple[str, ...] = ()  # names of the rows of bars or events, from the top
    height: int = 190  # [px]
    ticks: tuple[tuple[float, str], ...] = ()  # positions and labels on the horizontal axis; only in image files


@dataclass(frozen=True, slots=True)
class Shade:
    """Quantity that colours a track on a map."""

    name: str  # name with unit: ``horizontal sd [m]``
    values: FloatArray  # (n,) one value per point of the track
    classes: tuple[tuple[float, str], ...] = ()  # if the values are categories: each value with its name
    mode: str = ""  # position of the page's switch that offers the colouring, as in `Curve`


@dataclass(frozen=True, slots=True)
class Track:
    """Map in local metres, with true aspect ratio."""

    key: str
    title: str
    east: FloatArray  # (n,) [m]
    north: FloatArray  # (n,) [m]
    time: FloatArray  # (n,) times in the unit of the panels with the same `link`
    shades: tuple[Shade, ...]
    link: str = ""
    fixes: FloatArray | None = None  # (k, 2) measured positions, east and north [m]
    spans: tuple[tuple[float, float], ...] = ()  # marked intervals of `time`: outages
    note: str = ""
    behind: tuple[Curve, ...] = ()  # lines behind the track, east and north [m]: other solutions, street map
    height: int = 420  # [px]


Drawing = Panel | Track


def over_time(
    time: FloatArray,
    rows: Sequence[tuple[str, str, Sequence[tuple[str, FloatArray, str]], float]],
    note: str = "",
    link: str = "time",
) -> tuple[Panel, ...]:
    """Build panels of lines over time, to be placed below one another.

    `time` (n,) [s]. `rows`: for each panel its title, the label of its vertical axis, its lines (name, values (n,),
    colour), and the smallest range of this axis. `note`: explanation of the first panel.
    """
    clock = Clock.of(time)
    axis_time = clock(time)
    return tuple(
        Panel(
            f"{link}_{title}".lower().replace(" ", "_"),
            title,
            label,
            clock.label,
            tuple(Curve(name, axis_time, values, colour) for name, values, colour in lines),
            link,
            "" if i else note,
            least=least,
        )
        for i, (title, label, lines, least) in enumerate(rows)
    )


def bars(
    kinds: Sequence[str], colours: Mapping[str, str], low: FloatArray, high: FloatArray, text: Sequence[str]
) -> list[Curve]:
    """Build horizontal bars, one per row, as one curve per kind of bar.

    `kinds`, `low`, `high`, `text`: kind, left end, right end and hover text of the bar in each row. `colours`: by kind.
    """
    rows_of = {kind: [row for row, each in enumerate(kinds) if each == kind] for kind in colours}
    return [
        Curve(kind, high[i], np.array(i, np.float64), colours[kind], "bars", low[i], text=tuple(text[row] for row in i))
        for kind, i in rows_of.items()
        if i
    ]


def row_panel(key: str, title: str, label: str, curves: Iterable[Curve], rows: Sequence[str], note: str = "") -> Panel:
    """Build a panel of bars or points in named rows; its height suits their number. `label`: of the horizontal axis."""
    return Panel(key, title, "", label, tuple(curves), note=note, rows=tuple(rows), height=80 + 24 * len(rows))


def panel_data(drawing: Drawing) -> dict[str, Any]:
    """Convert a drawing to the JSON data that ``panels.js`` draws, with long curves thinned."""
    common = {
        "key": drawing.key,
        "link": drawing.link,
        "height": drawing.height,
        "spans": [[float(a), float(b)] for a, b in drawing.spans if np.isfinite((a, b)).all()],
    }
    return common | (_panel(drawing) if isinstance(drawing, Panel) else _track(drawing))


def modes(drawings: Sequence[Drawing]) -> tuple[str, ...]:
    """Return the positions of the page's switch that the drawings use, such as "smoothed", in order."""
    used = [each.mode for d in drawings for each in (d.curves if isinstance(d, Panel) else d.shades)]
    return tuple(dict.fromkeys(mode for mode in used if mode))


def _panel(panel: Panel) -> dict[str, Any]:
    limits_by_mode = {mode: limits_of(panel, mode) for mode in modes([panel]) or ("",)}
    return {
        "xLabel": plain_text(panel.x_label),
        "yLabel": plain_text(panel.y_label),
        "logX": "x" in panel.log,
        "logY": "y" in panel.log,
        "limits": {mode: [float(e) for e in limits] for mode, limits in limits_by_mode.items() if limits is not None},
        "levels": [[float(value), plain_text(name)] for value, name in panel.levels],
        "rows": [plain_text(name) for name in panel.rows],
        "curves": [_curve(each) for each in panel.curves if len(each.x)],
    }


def limits_of(panel: Panel, mode: str) -> tuple[float, float] | None:
    """Compute limits of the vertical axis from the curves visible at a position of the page's switch; None without."""
    visible = [curve for curve in panel.curves if curve.mode in ("", mode)]
    return panel.limits or _robust(visible, "y" in panel.log, panel.least)


def _robust(curves: Sequence[Curve], logarithmic: bool, least: float) -> tuple[float, float] | None:
    values = [each.y for each in curves if each.kind != "band"]
    bands = [edge for each in curves if each.kind == "band" for edge in (each.y, each.low) if edge is not None]
    # the view contains the middle 99 % of each edge of a band; the page states the range outside the view
    shares = (_TAIL, 100.0 - _TAIL)
    values += [np.percentile(finite, shares) for each in bands if (finite := each[np.isfinite(each)]).size]
    if not logarithmic:
        return robust_limits(values, least)
    limits = robust_limits([np.log10(each[each > 0.0]) for each in values], least=1.0)
    return None if limits is None else (10.0 ** limits[0], 10.0 ** limits[1])


def _curve(curve: Curve) -> dict[str, Any]:
    x, y, low, text = curve.x, curve.y, curve.low, curve.text
    if curve.kind == "band" and low is not None:
        x, low, y = envelope(x, low, y, BAND_BINS)
    elif curve.kind in ("line", "dashed", "thin"):
        x, y = thinned(x, y, LINE_BINS)
    elif not text and len(x) > MARKERS:
        x, y = thinned(x, y, MARKERS // 2)
    data = {
        "name": plain_text(curve.name),
        "kind": curve.kind,
        "colour": curve.colour,
        "mode": curve.mode,
        "x": packed(x),
        "y": packed(y),
    }
    if low is not None:
        data["low"] = packed(low)
    return data | ({"text": [plain_text(each) for each in text]} if text else {})


def _track(track: Track) -> dict[str, Any]:
    rows = np.unique(np.linspace(0, len(track.time) - 1, min(len(track.time), 2 * LINE_BINS)).round().astype(np.int64))
    fixes = np.empty((0, 2)) if track.fixes is None else track.fixes
    fixes = fixes[:: max(1, -(-len(fixes) // MARKERS))]
    return {
        "east": packed(track.east[rows]),
        "north": packed(track.north[rows]),
        "time": packed(track.time[rows]),
        "fixes": [packed(fixes[:, 0]), packed(fixes[:, 1])],
        "behind": [_behind(each) for each in track.behind],
        "shades": [
            {
                "name": plain_text(each.name),
                "mode": each.mode,
                "values": packed(each.values[rows]),
                "classes": [[float(value), plain_text(name)] for value, name in each.classes],
            }
            for each in track.shades
        ],
    }


def _behind(line: Curve) -> dict[str, Any]:
    """Convert a line behind a track to JSON data: a street map with all points, another solution thinned."""
    step = 1 if line.kind in ("thin", "crosses") else max(1, -(-len(line.x) // (2 * LINE_BINS)))
    points = {"x": packed(line.x[::step]), "y": packed(line.y[::step])}
    return {"name": plain_text(line.name), "kind": line.kind, "colour": line.colour, **points}


def packed(values: FloatArray) -> str:
    """Encode numbers as base64 text of little-endian 32-bit floats."""
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode("ascii")
