"""Parser of quantities with a unit, such as ``"0.1 deg/h"``."""

from __future__ import annotations

import math
import re

from insnav.exceptions import ConfigError
from insnav.units import UNITS, units_of

_QUANTITY = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)\s*$")


def parse_quantity(text: str, dimension: str, *, where: str = "") -> float:
    """Convert a text with a unit to a number in SI and radians.

    `text`: such as ``"0.1 deg/h"``; the unit is required. `dimension`: required dimension: ``"rate"``,
    ``"acceleration"``, ``"angle random walk"``, …. `where`: location named in the error.
    Raises: ConfigError: no unit, an unknown unit, a unit of another dimension, or a number that is not finite.

    Examples
    --------
    >>> from insnav.units import DEG
    >>> round(parse_quantity("3600 deg/h", "rate") / DEG, 12)
    1.0
    """
    units = tuple(units_of(dimension))
    match = _QUANTITY.match(text) if isinstance(text, str) else None
    if match is None:
        raise ConfigError("unit.missing", where=where, text=str(text), unit=units[0])
    number, unit = float(match[1]), match[2]
    if unit not in UNITS:
        raise ConfigError("unit.unknown", where=where, text=text, unit=unit, units=units)
    other, factor = UNITS[unit]
    if other != dimension:
        raise ConfigError(
            "unit.of_other_dimension", where=where, text=text, unit=unit, other=other, dimension=dimension, units=units
        )
    if not math.isfinite(number * factor):
        raise ConfigError("unit.not_finite", where=where, text=text)
    return number * factor
