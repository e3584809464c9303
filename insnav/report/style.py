"""Style of all reports: colours, and text of numbers, lengths and times.

The colours of Okabe and Ito (2008) are distinguishable with every common kind of colour vision and in grey print.
"""

from __future__ import annotations

import math

BLUE, ORANGE, GREEN, VERMILLION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
SKY, PURPLE, BLACK, GREY = "#56B4E9", "#CC79A7", "#000000", "#8A8A8A"
GRADES = {"consumer": VERMILLION, "automotive": ORANGE, "industrial": BLUE, "tactical": GREEN, "navigation": PURPLE}
AXIS_COLOURS = (BLUE, VERMILLION, GREEN)  # x, y, z
NED = ("north", "east", "down")
_UNKNOWN = "–"
_SMALLEST = 1e-7  # numbers down to this size are written without an exponent


def number(value: float | None, digits: int = 3) -> str:
    """Write a number with `digits` significant digits, without an exponent unless tiny. `value`: None gives a dash."""
    if value is None:
        return _UNKNOWN
    short = f"{value:#.{digits}g}"
    if "e+" in short:
        return f"{float(short):.0f}"
    if "e-" in short and abs(value) > _SMALLEST:
        return f"{value:.{digits - 1 - int(short.split('e')[1])}f}"
    return short.rstrip(".")


def rounded(value: float, sd: float) -> str:
    """Write a number, rounded at the second significant digit of its standard deviation; 3 to 12 significant digits."""
    scale = max(abs(value), 1e-300)
    if not sd > 0.0:
        return f"{value:.6g}"
    digits = math.floor(math.log10(scale)) - math.floor(math.log10(sd)) + 2
    return number(value, min(max(digits, 3), 12))


def distance_text(length_m: float) -> str:
    """Write a length given in metres; from 1000 m in kilometres."""
    return f"{number(length_m / 1000.0)} km" if length_m >= 1000.0 else f"{number(length_m)} m"


def duration_text(seconds: float) -> str:
    """Write a duration given in seconds; from 120 s in minutes, from 7200 s in hours."""
    if seconds >= 7200.0:
        return f"{number(seconds / 3600.0)} h"
    return f"{number(seconds / 60.0)} min" if seconds >= 120.0 else f"{number(seconds)} s"
