"""Windows without GPS as quantities, sentences and lines: what outage tests and budgets share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.errors.outage.statistics import Growth, common_error
from insnav.errors.outage.windows import Outage
from insnav.messages import sentence
from insnav.quantity import Quantity
from insnav.report.colours import BLACK, BLUE, GREY, ORANGE, VERMILLION
from insnav.report.numbers import number
from insnav.report.panels import Curve, Panel
from insnav.types import FloatArray
from insnav.units import UNITS

_POINTS = 24  # times at which the windows are summed up
NOTE = "errors of the reference in all lines"
_WINDOWS = 80  # drawn one by one
BELOW = "below reference noise"
INTERVALS = (
    "Intervals: RMS error of drives like this one, 95 % intended. In simulations they hold it in 90 to 99 % of cases "
    "where windows differ by chance, in 85 to 97 % where half of the variance is common to all windows of a drive: "
    "that part counts as one window."
)


def thin_lines(name: str, windows: Sequence[tuple[FloatArray, FloatArray]], most: int, points: int = 0) -> list[Curve]:
    """Draw the error of each window behind everything else.

    `windows`: time without GPS (n,) and error (n,) of each; `most`: of them, `points`: about so many of each, all if 0.
    """
    shown = np.linspace(0, len(windows) - 1, min(most, len(windows))).astype(int)
    step = max(1, len(windows[0][0]) // points) if points else 1
    return [Curve(name, windows[row][0][::step], windows[row][1][::step], GREY, "thin") for row in shown]


def power_lines(time: FloatArray, end: float, colour: str, least: float = 0.0) -> list[Curve]:
    """Lines of pure t, t² and t³ to one end, as far as they are above the least error that is in view."""
    lines = []
    for label, power in (("t", 1.0), ("t²", 2.0), ("t³", 3.0)):
        line = end * (time / time[-1]) ** power
        seen = line >= 1.2 * least
        if seen.sum() > 1:
            lines.append(Curve("", time[seen], line[seen], colour, "thin", text=(label,) * int(seen.sum())))
    return lines


def outage_panels(windows: Sequence[Outage], sums: Sequence[Growth]) -> tuple[Panel, ...]:
    """Draw horizontal and vertical errors of the longest windows."""
    longest = max(window.length for window in windows)
    chosen = [window for window in windows if window.length == longest]
    return tuple(_panel(chosen, sums, name, columns) for name, columns in (("horizontal", (0, 1)), ("vertical", (2,))))


def _panel(chosen: Sequence[Outage], sums: Sequence[Growth], name: str, columns: tuple[int, ...]) -> Panel:
    sizes = [(each.elapsed, np.linalg.norm(each.error[:, columns], axis=1)) for each in chosen]
    curves = thin_lines(f"each window of {chosen[0].length:g} s", sizes, _WINDOWS)
    time, rms, high, predicted = over_time(chosen, columns)
    curves += [
        Curve("95 %", time, high, ORANGE),
        Curve("RMS", time, rms, BLUE),
        Curve("predicted sd, solution and reference", time, predicted, BLACK, "dashed"),
    ]
    smoothed = [(each.length, float(each.rms[-1, each.column(f"smoothed {name}")])) for each in sums]
    known = np.array([pair for pair in smoothed if np.isfinite(pair[1])])
    if len(known):
        texts = tuple(f"smoothed, {length:g} s: {number(value)} m RMS" for length, value in known)
        curves.append(Curve("smoothed, RMS", known[:, 0], known[:, 1], VERMILLION, "crosses", text=texts))
    values = np.concatenate([rms, predicted, known[:, 1]] if len(known) else [rms, predicted])
    least = float(np.nanmin(values[values > 0.0])) if (values > 0.0).any() else 1e-3
    return Panel(
        f"outage_{name}",
        f"{name.capitalize()} error without GPS",
        f"{name} error [m]",
        "time without GPS [s]",
        tuple(curves),
        link="outage",
        note=NOTE,
        log_x=True,
        log_y=True,
        limits=(max(0.3 * least, 1e-4), 2.0 * float(np.nanmax(high))),
        height=280,
    )


def over_time(
    windows: Sequence[Outage], columns: tuple[int, ...]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """RMS, 95 % quantile and predicted sd of the error, reference errors in all, at logarithmically spaced times."""
    first = max(float(window.elapsed[0]) for window in windows)
    time = np.geomspace(max(first, 0.2), windows[0].length, _POINTS)
    size, sd = np.empty((len(windows), _POINTS)), np.empty((len(windows), _POINTS))
    for row, window in enumerate(windows):
        size[row] = np.interp(time, window.elapsed, np.linalg.norm(window.error[:, columns], axis=1))
        sd[row] = np.interp(
            time, window.elapsed, np.linalg.norm(np.hypot(window.sd, window.reference_sd)[:, columns], axis=1)
        )
    return time, np.sqrt(np.mean(size**2, axis=0)), np.quantile(size, 0.95, axis=0), np.sqrt(np.mean(sd**2, axis=0))


def corrected(found: Growth, i: int, unit: str = "m", meaning: str = "corrected (95 %)") -> Quantity:
    """RMS error without the reference at the last time, with its interval; in words where nothing is left."""
    low, high = float(found.low[-1, i]), float(found.high[-1, i])
    if found.below_noise[-1, i]:
        text = below_noise(high / UNITS[unit][1]).replace(" reference", "")  # in a table of 80 columns
        return Quantity("rms_corrected", text, unit, meaning=meaning)
    return Quantity("rms_corrected", float(found.corrected[-1, i]), unit, interval=(low, high), meaning=meaning)


def below_noise(high: float, unit: str = "") -> str:
    """Say that an error is below the noise of the reference, and how large it may be, in the unit shown."""
    return f"{BELOW} (< {number(high)}{unit})" if np.isfinite(high) and high > 0.0 else BELOW


def corrected_text(value: float, low: float, high: float) -> str:
    """Write an RMS error without the reference, which may be below its noise, with its interval [m]."""
    if not np.isfinite(value):
        return below_noise(high, " m")
    return f"{number(value)} m RMS" + (f" ({number(low)} … {number(high)} m)" if np.isfinite(low) else "")


def common_text(found: Growth) -> str:
    """Say how much of the horizontal error is common to all windows, if it is much."""
    return "".join(map(sentence, common_error(found)))
