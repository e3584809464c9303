"""Units by name, and their factors to SI.

Numbers that enter or leave insnav have a written unit. Inside the package, all numbers are in SI units and radians.
"""

from __future__ import annotations

import math

DEG = math.pi / 180.0
HOUR = 3600.0
G0 = 9.80665  # standard gravity [m/s^2], CGPM 1901
UG = 1e-6 * G0
MGAL = 1e-5
PPM = 1e-6

DEG_PER_H = DEG / HOUR
DEG_PER_SQRT_H = DEG / math.sqrt(HOUR)
M_S_PER_SQRT_H = 1.0 / math.sqrt(HOUR)

# units of each dimension, and their factors to SI
_FACTORS: dict[str, dict[str, float]] = {
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": DEG, "arcmin": DEG / 60.0, "arcsec": DEG / 3600.0},
    "rate": {"rad/s": 1.0, "deg/s": DEG, "deg/h": DEG_PER_H},
    "acceleration": {"m/s^2": 1.0, "g": G0, "mg": 1e-3 * G0, "ug": UG, "mGal": MGAL},
    "angle random walk": {
        "rad/sqrt(s)": 1.0,
        "deg/sqrt(s)": DEG,
        "deg/sqrt(h)": DEG_PER_SQRT_H,
        "deg/s/sqrt(Hz)": DEG,
        "mdeg/s/sqrt(Hz)": 1e-3 * DEG,
        "deg/h/sqrt(Hz)": DEG_PER_H,
        "rad/s/sqrt(Hz)": 1.0,
    },
    "velocity random walk": {
        "m/s/sqrt(s)": 1.0,
        "m/s/sqrt(h)": M_S_PER_SQRT_H,
        "ft/s/sqrt(h)": 0.3048 * M_S_PER_SQRT_H,
        "m/s^2/sqrt(Hz)": 1.0,
        "ug/sqrt(Hz)": UG,
        "mg/sqrt(Hz)": 1e-3 * G0,
    },
    "ratio": {"ppm": PPM, "%": 1e-2, "1": 1.0},
    "mass": {"kg": 1.0},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3},
    "velocity": {"m/s": 1.0, "km/h": 1.0 / 3.6, "cm/s": 1e-2, "mm/s": 1e-3},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": HOUR},
    # raw sensor outputs
    "signal": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "LSB": 1.0},
    "jerk": {"m/s^3": 1.0, "g/s": G0},
    "rate ramp": {"rad/s^2": 1.0, "deg/s/s": DEG, "deg/h/s": DEG_PER_H, "deg/h/h": DEG_PER_H / HOUR},
    "acceleration ramp": {"ug/s": UG, "ug/h": UG / HOUR, "(m/s^2)/s": 1.0},
    "rate per kelvin": {"deg/h/K": DEG_PER_H, "deg/s/K": DEG, "(rad/s)/K": 1.0},
    "acceleration per kelvin": {"ug/K": UG, "mg/K": 1e-3 * G0, "(m/s^2)/K": 1.0},
    "ratio per kelvin": {"ppm/K": PPM, "1/K": 1.0},
    "rate per acceleration": {"deg/h/g": DEG_PER_H / G0, "deg/s/g": DEG / G0, "(rad/s)/(m/s^2)": 1.0},
    "rate per acceleration squared": {"deg/h/g^2": DEG_PER_H / G0**2, "(rad/s)/(m/s^2)^2": 1.0},
    "per acceleration": {"ug/g^2": UG / G0**2, "1/(m/s^2)": 1.0},
    "per rate": {"ppm/(deg/s)": PPM / DEG, "1/(rad/s)": 1.0},
    "frequency": {"Hz": 1.0, "1/h": 1.0 / HOUR},
    "vibration density": {"(m/s^2)^2/Hz": 1.0, "g^2/Hz": G0 * G0},
}
# dimension and factor to SI of each unit, by its text
UNITS = {unit: (dimension, factor) for dimension, units in _FACTORS.items() for unit, factor in units.items()}
# units of the random walk of a bias: unit of the bias divided by the root of a time unit
UNITS |= {
    f"{name}/sqrt({time})": (f"{dimension} random walk", factor / math.sqrt(seconds))
    for name, (dimension, factor) in UNITS.items()
    if dimension in ("rate", "acceleration")
    for time, seconds in (("s", 1.0), ("h", HOUR))
}

# spellings in data sheets, and their spelling in `UNITS`
_SPELLED = (
    *(("hr", "h"), ("µ", "u"), ("μ", "u"), ("°", "deg"), ("rtHz", "sqrt(Hz)"), ("√Hz", "sqrt(Hz)"), ("√h", "sqrt(h)")),
    *(("√s", "sqrt(s)"), ("dph", "deg/h"), ("dps", "deg/s"), ("²", "^2"), ("³", "^3")),
)
_PRETTY = (("ug", "µg"), ("sqrt(Hz)", "√Hz"), ("sqrt(h)", "√h"), ("sqrt(s)", "√s"), ("^2", "²"), ("^3", "³"))


def plain_unit(unit: str) -> str:
    """Spell a unit of a data sheet as in `UNITS`: ``deg/s/sqrt(Hz)`` for ``dps/√Hz``."""
    for spelled, plain in _SPELLED:
        unit = unit.replace(spelled, plain)
    return unit


def shown_unit(unit: str) -> str:
    """Write a unit in readable form: ``deg/√h`` for ``deg/sqrt(h)``."""
    for plain, pretty in _PRETTY:
        unit = unit.replace(plain, pretty)
    return unit


def units_of(dimension: str) -> list[str]:
    """List all units of a dimension, such as ``"rate"``; see `UNITS`."""
    return [name for name, (dim, _) in UNITS.items() if dim == dimension]


def si_unit(dimension: str) -> str:
    """Return the SI unit of a dimension, which has the factor one."""
    return next(name for name, (dim, factor) in UNITS.items() if dim == dimension and factor == 1.0)
