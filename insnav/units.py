"""Units by name: the factors to SI, and the parser of texts such as ``"0.1 deg/h"``.

A unit is always written out where a number enters or leaves insnav; inside there is only SI and radians.
"""

from __future__ import annotations

import math
import re

from insnav.exceptions import ConfigError

DEG = math.pi / 180.0
HOUR = 3600.0
G0 = 9.80665  # standard gravity [m/s^2], CGPM 1901
UG = 1e-6 * G0
MGAL = 1e-5
PPM = 1e-6

DEG_PER_H = DEG / HOUR
DEG_PER_SQRT_H = DEG / math.sqrt(HOUR)
M_S_PER_SQRT_H = 1.0 / math.sqrt(HOUR)

# unit text -> (dimension, factor to SI)
UNITS: dict[str, tuple[str, float]] = {
    "rad": ("angle", 1.0),
    "mrad": ("angle", 1e-3),
    "deg": ("angle", DEG),
    "arcmin": ("angle", DEG / 60.0),
    "arcsec": ("angle", DEG / 3600.0),
    "rad/s": ("rate", 1.0),
    "deg/s": ("rate", DEG),
    "deg/h": ("rate", DEG_PER_H),
    "m/s^2": ("acceleration", 1.0),
    "g": ("acceleration", G0),
    "mg": ("acceleration", 1e-3 * G0),
    "ug": ("acceleration", UG),
    "mGal": ("acceleration", MGAL),
    "rad/sqrt(s)": ("angle random walk", 1.0),
    "deg/sqrt(s)": ("angle random walk", DEG),
    "deg/sqrt(h)": ("angle random walk", DEG_PER_SQRT_H),
    "deg/s/sqrt(Hz)": ("angle random walk", DEG),
    "deg/h/sqrt(Hz)": ("angle random walk", DEG_PER_H),
    "rad/s/sqrt(Hz)": ("angle random walk", 1.0),
    "m/s/sqrt(s)": ("velocity random walk", 1.0),
    "m/s/sqrt(h)": ("velocity random walk", M_S_PER_SQRT_H),
    "ft/s/sqrt(h)": ("velocity random walk", 0.3048 * M_S_PER_SQRT_H),
    "m/s^2/sqrt(Hz)": ("velocity random walk", 1.0),
    "ug/sqrt(Hz)": ("velocity random walk", UG),
    "mg/sqrt(Hz)": ("velocity random walk", 1e-3 * G0),
    "ppm": ("ratio", PPM),
    "%": ("ratio", 1e-2),
    "1": ("ratio", 1.0),
    "kg": ("mass", 1.0),
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "km": ("length", 1e3),
    "m/s": ("velocity", 1.0),
    "km/h": ("velocity", 1.0 / 3.6),
    "cm/s": ("velocity", 1e-2),
    "mm/s": ("velocity", 1e-3),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "min": ("time", 60.0),
    "h": ("time", HOUR),
    "V": ("signal", 1.0),  # what a sensor puts out before it is calibrated
    "mV": ("signal", 1e-3),
    "uV": ("signal", 1e-6),
    "LSB": ("signal", 1.0),
    "m/s^3": ("jerk", 1.0),
    "g/s": ("jerk", G0),
    "rad/s^2": ("rate ramp", 1.0),
    "deg/s/s": ("rate ramp", DEG),
    "deg/h/s": ("rate ramp", DEG_PER_H),
    "deg/h/h": ("rate ramp", DEG_PER_H / HOUR),
    "ug/s": ("acceleration ramp", UG),
    "ug/h": ("acceleration ramp", UG / HOUR),
    "(m/s^2)/s": ("acceleration ramp", 1.0),
    "deg/h/K": ("rate per kelvin", DEG_PER_H),
    "deg/s/K": ("rate per kelvin", DEG),
    "(rad/s)/K": ("rate per kelvin", 1.0),
    "ug/K": ("acceleration per kelvin", UG),
    "mg/K": ("acceleration per kelvin", 1e-3 * G0),
    "(m/s^2)/K": ("acceleration per kelvin", 1.0),
    "ppm/K": ("ratio per kelvin", PPM),
    "1/K": ("ratio per kelvin", 1.0),
    "deg/h/g": ("rate per acceleration", DEG_PER_H / G0),
    "deg/s/g": ("rate per acceleration", DEG / G0),
    "(rad/s)/(m/s^2)": ("rate per acceleration", 1.0),
    "deg/h/g^2": ("rate per acceleration squared", DEG_PER_H / G0**2),
    "(rad/s)/(m/s^2)^2": ("rate per acceleration squared", 1.0),
    "ug/g^2": ("per acceleration", UG / G0**2),
    "1/(m/s^2)": ("per acceleration", 1.0),
    "ppm/(deg/s)": ("per rate", PPM / DEG),
    "1/(rad/s)": ("per rate", 1.0),
    "Hz": ("frequency", 1.0),
    "(m/s^2)^2/Hz": ("vibration density", 1.0),
    "g^2/Hz": ("vibration density", G0 * G0),
}
# random walks of a bias: the unit of the bias over the root of a time
UNITS |= {
    f"{name}/sqrt({time})": (f"{dimension} random walk", factor / math.sqrt(seconds))
    for name, (dimension, factor) in UNITS.items()
    if dimension in ("rate", "acceleration")
    for time, seconds in (("s", 1.0), ("h", HOUR))
}

_QUANTITY = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)\s*$")


def units_of(dimension: str) -> list[str]:
    """Names of all units of a dimension, such as ``"rate"``; see `UNITS`."""
    return [name for name, (dim, _) in UNITS.items() if dim == dimension]


def si_unit(dimension: str) -> str:
    """Name of the unit of a dimension whose factor is one."""
    return next(name for name, (dim, factor) in UNITS.items() if dim == dimension and factor == 1.0)


def parse_quantity(text: str, dimension: str, *, where: str = "") -> float:
    """Number in SI and radians of a text with a unit.

    `text`: such as ``"0.1 deg/h"``; the unit is obligatory; `dimension`: what it must be: ``"rate"``,
    ``"acceleration"``, ``"angle random walk"``, …; `where`: place to name in the error.
    Raises: ConfigError: no unit, an unknown unit, a unit of another dimension, or a number that is not finite.

    Examples
    --------
    >>> round(parse_quantity("3600 deg/h", "rate") / DEG, 12)
    1.0
    """
    choices = ", ".join(units_of(dimension))
    match = _QUANTITY.match(text) if isinstance(text, str) else None
    if match is None:
        raise ConfigError(
            f"{text!r} is not a number with a unit",
            where=where,
            fix=f'write it like "1.5 {units_of(dimension)[0]}"',
        )
    number, unit = float(match[1]), match[2]
    found = UNITS.get(unit)
    if found is None or found[0] != dimension:
        why = f"{unit!r} is not a unit" if found is None else f"{unit!r} is a unit of {found[0]}, not of {dimension}"
        raise ConfigError(f"{text!r} is not a {dimension}", where=where, why=why, fix=f"use one of {choices}")
    value = number * found[1]
    if not math.isfinite(value):
        raise ConfigError(f"{text!r} is not finite", where=where)
    return value
