"""Schema of data columns: canonical names, common spellings, and spellings of units.

``columns.toml`` contains them. Spellings are compared in compact form (see `compact`): ``gyro_x``, ``GyroX`` and
``gyro.x`` are equal.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from insnav.units import DEG, G0, UNITS

_LETTERS = str.maketrans({"²": "2", "³": "3", "°": "deg", "µ": "u", "μ": "u", "ω": "omega", "θ": "theta", "Δ": "d"})


def compact(text: str) -> str:
    """Reduce a name to lower-case letters and digits, so that different spellings of the name become equal.

    Examples
    --------
    >>> compact("Gyro_X"), compact("m/s²")
    ('gyrox', 'ms2')
    """
    return re.sub(r"[^a-z0-9]", "", text.translate(_LETTERS).lower())


@dataclass(frozen=True, slots=True)
class Quantity:
    """Quantity that a column can contain."""

    key: str  # name without unit, such as ``gyro_x``
    name: str  # canonical column name, such as ``gyro_x_rad_s``
    dimension: str  # dimension of its unit as in `insnav.units.UNITS`, ``temperature``, or empty for a plain number
    unit: str  # unit of the canonical name
    spellings: tuple[str, ...]  # compact spellings, the most reliable first


_NAMES = tomllib.loads(Path(__file__).with_name("columns.toml").read_text(encoding="utf-8"))


def _spread(spellings: str, marks: Iterable[str]) -> tuple[str, ...]:
    return tuple(word.replace("?", mark) for mark in marks for word in spellings.split())


def _named(text: str, table: str) -> str:
    """Replace each ``$word`` in a text by its definition in a table of ``columns.toml``."""
    return re.sub(r"\$(\w+)", lambda found: str(_NAMES[table][found[1]]), text)


def _quantities(name: str) -> Iterator[Quantity]:
    """Yield the quantities of an entry of ``columns.toml``: one, or one for each of the axes x, y, z."""
    key = name.partition("@")[0]
    canonical, dimension, unit, text, *extras = _NAMES["quantities"][name]
    spellings = _named(text, "words")
    if "?" not in key:
        yield Quantity(key, canonical, dimension, unit, _spread(spellings, " ".join(extras).split() or [""]))
        return
    for i, axis in enumerate("xyz"):
        axis_spellings = extras[i].split() if extras else ()
        names = key.replace("?", axis), canonical.replace("?", axis)
        yield Quantity(*names, dimension, unit, (*_spread(spellings, (axis, str(i))), *axis_spellings))


def schema(kind: str) -> tuple[Quantity, ...]:
    """Return the quantities that a kind of file may contain, from ``columns.toml``."""
    return tuple(quantity for name in _named(_NAMES["files"][kind], "files").split() for quantity in _quantities(name))


IMU_SCHEMA, GPS_SCHEMA, REFERENCE_SCHEMA = schema("imu"), schema("gps"), schema("reference")
# Logs of further sensors: their quantities, and the alternative sets of required columns.
LOG_SCHEMAS: dict[str, tuple[tuple[Quantity, ...], tuple[tuple[str, ...], ...]]] = {
    name: (schema(name), tuple(tuple(keys.split()) for keys in needed)) for name, needed in _NAMES["logs"].items()
}

PREFIXES = tuple(_NAMES["prefixes"].split())  # beginnings of headers that `match_header` skips

_MORE_UNITS: dict[str, dict[str, float]] = {
    "time": {"us": 1e-6, "ns": 1e-9},
    "rate": {"mdeg/s": 1e-3 * DEG, "mrad/s": 1e-3, "r/min": 6.0 * DEG},
    "angle": {"urad": 1e-6},
    "acceleration": {"cm/s^2": 1e-2, "mm/s^2": 1e-3, "ft/s^2": 0.3048},
    "velocity": {"knot": 1852.0 / 3600.0, "mph": 0.44704, "ft/s": 0.3048, "g*s": G0},
    "length": {"ft": 0.3048},
    "temperature": {"degC": 1.0},
}
ALL_UNITS = UNITS | {unit: (kind, size) for kind, units in _MORE_UNITS.items() for unit, size in units.items()}


def _unit_table() -> dict[str, dict[str, str]]:
    table: dict[str, dict[str, str]] = {}
    for unit, (dimension, _) in ALL_UNITS.items():
        words = [compact(unit), *_NAMES["units"].get(unit, "").split()]
        for word in words:
            table.setdefault(dimension, {})[word] = unit
    return table


# unit by dimension and compact spelling
UNIT_SPELLINGS: dict[str, dict[str, str]] = _unit_table()
