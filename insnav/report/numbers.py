"""Facts in words: keys with their unit in brackets, numbers as short as they may be."""

from __future__ import annotations

import math
from typing import Any

from insnav.plain_text import plain_text

_UNITS = {
    "deg_sqrt_h": "deg/√h",
    "m_s_sqrt_h": "m/s/√h",
    "deg_h": "deg/h",
    "m_s2": "m/s²",
    "m_s": "m/s",
    "rad_s": "rad/s",
    "deg_s": "deg/s",
    "hz": "Hz",
    "deg": "deg",
    "rad": "rad",
    "ppm": "ppm",
    "mg": "mg",
    "ug": "ug",
    "m": "m",
    "s": "s",
    "h": "h",
}
_UNKNOWN = "–"


def label(key: str) -> str:
    """Name of a fact, its unit in brackets.

    Parameters
    ----------
    key : str
        Such as ``gyro_bias_deg_h``.

    Examples
    --------
    >>> label("gyro_bias_deg_h")
    'gyro bias [deg/h]'
    """
    for suffix, unit in _UNITS.items():
        if key.endswith(f"_{suffix}"):
            return f"{plain_text(key[: -len(suffix) - 1]).replace('_', ' ')} [{unit}]"
    return plain_text(key).replace("_", " ")


def number(value: float | None, digits: int = 3) -> str:
    """Write a number with so many significant digits, large ones without an exponent.

    Parameters
    ----------
    value : float or None
        None gives a dash.
    digits : int
    """
    if value is None:
        return _UNKNOWN
    short = f"{value:#.{digits}g}"
    return f"{float(short):.0f}" if "e+" in short else short.rstrip(".")


def rounded(value: float, sd: float) -> str:
    """Number to the second digit of its standard deviation, never in less than three.

    Parameters
    ----------
    value, sd : float
    """
    scale = max(abs(value), 1e-300)
    if not sd > 0.0:
        return f"{value:.6g}"
    digits = math.floor(math.log10(scale)) - math.floor(math.log10(sd)) + 2
    text = f"{value:#.{min(max(digits, 3), 12)}g}"
    return text.rstrip(".")


def shown(value: Any) -> str:
    """Text of any fact: numbers in six digits, lists with commas, a dash for what is not known.

    Parameters
    ----------
    value : object
        As it comes from JSON.
    """
    if value is None or value == "" or value == [] or value == {}:
        return _UNKNOWN
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.10g}"
    if isinstance(value, list):
        return ", ".join(f"{item:.6g}" if isinstance(item, float) else shown(item) for item in value)
    if isinstance(value, dict):
        return ", ".join(f"{label(str(key))}: {shown(item)}" for key, item in value.items())
    return plain_text(value)
