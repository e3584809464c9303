"""Interactive drawings of a page, and preparation of series: time axes, thinning, robust limits.

``templates/panels.js`` draws them with BokehJS in the browser. Panels of one `Panel.link` share their horizontal axis
and one cursor, also with a map of the same link.
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

BINS = 1200  # about one per pixel: the visible resolution
_TAIL = 0.5  # share on either side that may exceed the limits [%]
_WORTH = 1.5  # full limits are used up to this multiple of the robust ones
LEAST_ERROR = 1e-4  # begin of error distributions: their axes are logarithmic [m]
LINE_BINS = 1000  # a line keeps the smallest and largest value of so many intervals
BAND_BINS = 500
MARKERS = 2000  # largest number of points of a cloud, including extremes
Kind = Literal["line", "dashed", "thin", "points", "crosses", "band", "bars"]


@dataclass(frozen=True, slots=True)
class Clock:
    """Time axis of one run: seconds, minutes or hours since its start."""

    start: float  # zero of the axis, in the time of the data [s]
    unit_s: float  # length of the axis' unit [s]
    unit: str
    label: str  # axis label

    @classmethod
    def of(cls, time: FloatArray) -> Clock:
        """Choose the axis for a run from all its times ``(n,)`` [s]."""
        start = float(time[0]) if len(time) else 0.0
        length = float(time[-1]) - start if len(time) else 0.0
        unit_s, unit = (3600.0, "h") if length > 6 * 3600.0 else (60.0, "min") if length > 900.0 else (1.0, "s")
        since = f" since {start:.1f} s" if start else ""
        return cls(start, unit_s, unit, f"time{since} [{unit}]")

    def __call__(self, time: Any) -> Any:
        """Convert times of the data [s] to axis positions."""
        return (np.asarray(time) - self.start) / self.unit_s

    def moment(self, begin: float, end: float) -> str:
        """Format a time of the data, or a span [s], in axis units."""
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
    """Thin a band ``(n,)`` to at most `bins` points without narrowing it; breaks (NaN) are kept."""
    if len(time) <= bins:
        return time, low, high
    starts = np.linspace(0, len(time), bins + 1).astype(np.int64)[:-1]
    return time[starts], np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)


def thinned(time: FloatArray, value: FloatArray, bins: int = BINS) -> tuple[FloatArray, FloatArray]:
    """Thin a line ``(n,)`` to its smallest and largest value in each of `bins` intervals; breaks (NaN) are kept."""
    if len(time) <= 2 * bins:
        return time, value
    length = -(-len(time) // bins)
    padding = -len(time) % length
    blocks = np.concatenate((value, np.full(padding, value[-1]))).reshape(-1, length)
    broken = np.isnan(blocks)
    low = np.argmin(np.where(broken, np.inf, blocks), axis=1)
    high = np.argmax(np.where(broken, -np.inf, blocks), axis=1)
    gap = np.where(broken.any(axis=1), np.argmax(broken, axis=1), low)
    first = np.arange(len(blocks)) * length
    rows = np.unique(np.concatenate((first + low, first + high, first + gap, [len(time) - 1])))
    rows = rows[rows < len(time)]
    return time[rows], value[rows]


def broken_at_gaps(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Insert a row of NaN into every gap of values ``(n, k)``, to interrupt the line."""
    if len(time) < 3:
        return time, values
    step = np.diff(time)
    after = np.flatnonzero(step > 5.0 * np.median(step)) + 1
    if not after.size:
        return time, values
    return np.insert(time, after, time[after]), np.insert(values, after, np.nan, axis=0)


def robust_limits(values: Iterable[FloatArray], least: float = 0.0) -> tuple[float, float] | None:
    """Compute limits of an axis that are robust against a few outliers.

    `values`: arrays (n,) of any lengths, with equal weight. `least`: smallest height of the view.
    Returns: None without finite values.
    """
    known = [each[np.isfinite(each)] for each in values]
    known = [each for each in known if each.size]
    if not known:
        return None
    low, high = min(float(each.min()) for each in known), max(float(each.max()) for each in known)
    most = [np.percentile(each, (_TAIL, 100.0 - _TAIL)) for each in known]
    robust = min(float(a) for a, _ in most), max(float(b) for _, b in most)
    if high - low > _WORTH * (robust[1] - robust[0]) > 0.0:
        low, high = robust
    margin = 0.06 * (high - low)
    half = max(0.5 * (high - low) + margin, 0.5 * least, 1e-12 * max(abs(low), abs(high)), 1e-12)
    return 0.5 * (low + high) - half, 0.5 * (low + high) + half


def wrapped(heading: FloatArray) -> FloatArray:
    """Wrap headings (n,) [deg] to 0..360, broken at north."""
    found = heading % 360.0
    found[1:][np.abs(np.diff(found)) > 180.0] = np.nan
    return found


@dataclass(frozen=True, slots=True)
class Curve:
    """Line, band, cloud of points or set of bars. Curves of one name share a legend entry."""

    name: str  # empty: not in the legend
    x: FloatArray  # (n,); of bars: their right ends
    y: FloatArray  # (n,); of a band: its upper edge; of bars: the row, 0 at the top
    colour: str  # "#RRGGBB", from `insnav.report.style`; the dark page lightens it
    kind: Kind = "line"
    low: FloatArray | None = None  # (n,) lower edge of a band, left ends of bars
    mode: str = ""  # switch position of the page that shows it, such as "filtered"; empty: always
    # hover text of points and bars, label at the start of a thin line, or name on a line
    text: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Panel:
    """Curves over one horizontal axis."""

    key: str  # its id in the page
    title: str
    y_label: str  # including the unit: ``error [m]``
    x_label: str
    curves: tuple[Curve, ...]
    link: str = ""  # panels with equal link share horizontal axis and cursor
    note: str = ""  # explanation
    log: Literal["", "x", "y", "xy"] = ""  # which axes are logarithmic
    limits: tuple[float, float] | None = None  # of the vertical axis; None: by the curves, without outliers
    least: float = 0.0  # smallest height of the view: a constant is drawn as a line, not as its rounding
    levels: tuple[tuple[float, str], ...] = ()  # horizontal lines with their names: gates
    spans: tuple[tuple[float, float], ...] = ()  # shaded intervals of the horizontal axis
    rows: tuple[str, ...] = ()  # names of the rows of bars or of events, from the top
    height: int = 190  # [px]
    ticks: tuple[tuple[float, str], ...] = ()  # labels on the horizontal axis, of figures for papers alone


@dataclass(frozen=True, slots=True)
class Shade:
    """Colouring of a track."""

    name: str  # with the unit: ``horizontal sd [m]``
    values: FloatArray  # (n,)
    classes: tuple[tuple[float, str], ...] = ()  # names of the values if they are categories
    mode: str = ""  # as in `Curve`


@dataclass(frozen=True, slots=True)
class Track:
    """Map in local metres, with true aspect ratio."""

    key: str
    title: str
    east: FloatArray  # (n,) [m]
    north: FloatArray  # (n,) [m]
    time: FloatArray  # (n,) on the axis of `link`
    shades: tuple[Shade, ...]
    link: str = ""
    fixes: FloatArray | None = None  # (k, 2) measured positions, east and north [m]
    spans: tuple[tuple[float, float], ...] = ()  # marked intervals of `time`: outages
    note: str = ""
    behind: tuple[Curve, ...] = ()  # background lines, east and north [m]: other solutions, a backdrop
    height: int = 420  # [px]


Drawing = Panel | Track


def over_time(
    time: FloatArray,
    rows: Sequence[tuple[str, str, Sequence[tuple[str, FloatArray, str]], float]],
    note: str = "",
    link: str = "time",
) -> tuple[Panel, ...]:
    """Draw lines over time, in panels above one another.

    `time` (n,) [s]. `rows`: for each panel title, label of its axis, lines (name, values (n,), colour), and the
    smallest height of its view. `note`: on the first.
    """
    clock = Clock.of(time)
    at = clock(time)
    return tuple(
        Panel(
            f"{link}_{title}".lower().replace(" ", "_"),
            title,
            label,
            clock.label,
            tuple(Curve(name, at, values, colour) for name, values, colour in lines),
            link,
            "" if i else note,
            least=least,
        )
        for i, (title, label, lines, least) in enumerate(rows)
    )


def bars(
    kinds: Sequence[str], colours: Mapping[str, str], low: FloatArray, high: FloatArray, text: Sequence[str]
) -> list[Curve]:
    """Draw one bar per row, one curve per kind in its colour. `kinds`, `low`, `high`, `text`: of the rows."""
    rows = {kind: [row for row, each in enumerate(kinds) if each == kind] for kind in colours}
    return [
        Curve(kind, high[at], np.array(at, np.float64), colours[kind], "bars", low[at], text=tuple(text[i] for i in at))
        for kind, at in rows.items()
        if at
    ]


def row_panel(key: str, title: str, label: str, curves: Iterable[Curve], rows: Sequence[str], note: str = "") -> Panel:
    """Build a panel of bars or points in named rows, as high as they need. `label`: of the horizontal axis."""
    return Panel(key, title, "", label, tuple(curves), note=note, rows=tuple(rows), height=80 + 24 * len(rows))


def panel_data(drawing: Drawing) -> dict[str, Any]:
    """Convert a drawing for ``panels.js``, thinned, ready for JSON."""
    common = {
        "key": drawing.key,
        "link": drawing.link,
        "height": drawing.height,
        "spans": [[float(a), float(b)] for a, b in drawing.spans if np.isfinite((a, b)).all()],
    }
    return common | (_panel(drawing) if isinstance(drawing, Panel) else _track(drawing))


def modes(drawings: Sequence[Drawing]) -> tuple[str, ...]:
    """Return the switch positions of the drawings, in order."""
    found = [each.mode for d in drawings for each in (d.curves if isinstance(d, Panel) else d.shades)]
    return tuple(dict.fromkeys(mode for mode in found if mode))


def _panel(panel: Panel) -> dict[str, Any]:
    known = {mode: limits_of(panel, mode) for mode in modes([panel]) or ("",)}  # by positions of the switch
    return {
        "xLabel": plain_text(panel.x_label),
        "yLabel": plain_text(panel.y_label),
        "logX": "x" in panel.log,
        "logY": "y" in panel.log,
        "limits": {mode: [float(each) for each in limits] for mode, limits in known.items() if limits is not None},
        "levels": [[float(value), plain_text(name)] for value, name in panel.levels],
        "rows": [plain_text(name) for name in panel.rows],
        "curves": [_curve(each) for each in panel.curves if len(each.x)],
    }


def limits_of(panel: Panel, mode: str) -> tuple[float, float] | None:
    """Compute limits of the vertical axis at a switch position; None without data."""
    own = [each for each in panel.curves if each.mode in ("", mode)]
    return panel.limits or _robust(own, "y" in panel.log, panel.least)


def _robust(curves: Sequence[Curve], logarithmic: bool, least: float) -> tuple[float, float] | None:
    values = [each.y for each in curves if each.kind != "band"]
    bands = [edge for each in curves if each.kind == "band" for edge in (each.y, each.low) if edge is not None]
    # 99 % of a band is in view, and the page names the cut range
    most = (_TAIL, 100.0 - _TAIL)
    values += [np.percentile(known, most) for each in bands if (known := each[np.isfinite(each)]).size]
    if not logarithmic:
        return robust_limits(values, least)
    found = robust_limits([np.log10(each[each > 0.0]) for each in values], least=1.0)
    return None if found is None else (10.0 ** found[0], 10.0 ** found[1])


def _curve(curve: Curve) -> dict[str, Any]:
    x, y, low, text = curve.x, curve.y, curve.low, curve.text
    if curve.kind == "band" and low is not None:
        x, low, y = envelope(x, low, y, BAND_BINS)
    elif curve.kind in ("line", "dashed", "thin"):
        x, y = thinned(x, y, LINE_BINS)
    elif not text and len(x) > MARKERS:
        x, y = thinned(x, y, MARKERS // 2)
    found = {
        "name": plain_text(curve.name),
        "kind": curve.kind,
        "colour": curve.colour,
        "mode": curve.mode,
        "x": packed(x),
        "y": packed(y),
    }
    if low is not None:
        found["low"] = packed(low)
    return found | ({"text": [plain_text(each) for each in text]} if text else {})


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
    """Convert a background line of a map: all points of a backdrop, a thinned drive."""
    step = 1 if line.kind in ("thin", "crosses") else max(1, -(-len(line.x) // (2 * LINE_BINS)))
    points = {"x": packed(line.x[::step]), "y": packed(line.y[::step])}
    return {"name": plain_text(line.name), "kind": line.kind, "colour": line.colour, **points}


def packed(values: FloatArray) -> str:
    """Encode numbers as 32-bit floats, base64."""
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode("ascii")
