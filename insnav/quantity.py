"""Quantity of a result: value, unit, uncertainty and label, defined once for text, page and JSON."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from insnav.types import FloatArray
from insnav.units import UNITS, shown_unit

_One: TypeAlias = "float | int | bool | str | FloatArray | Sequence[float] | Sequence[str] | Sequence[int] | None"
Value: TypeAlias = "_One | Mapping[str, _One]"


ABBREVIATIONS = re.compile(r"\b(cdf|cep|dop|gnss|gps|imu|nees|nhc|nis|ned|rms|zaru|zupt)\b")  # capitals in labels


@dataclass(frozen=True, slots=True)
class Quantity:
    """Quantity of a result, with unit and uncertainty."""

    key: str  # name in JSON without its unit, such as ``gyro_bias``; the unit is appended
    # in SI; None if unknown. A mapping has several statistics of the quantity, such as ``rms`` and ``max``, each for a
    # table column.
    value: Value
    # display unit: of `insnav.units`, or another unit, in which `value` then is (``V/(deg/s)``); empty without unit
    unit: str = ""
    sd: Value = None  # one standard deviation, in SI
    interval: tuple[float, float] | None = None  # 95 % interval, in SI
    meaning: str = ""  # label in text; if empty, the key in words
    digits: int = 3  # significant digits in text, unless `sd` determines them
    mark: str = ""  # appended to the value in text: ``!`` if it exceeds a limit
    # number of decimals in text, instead of `digits`, for values counted from an arbitrary zero: times, latitudes
    decimals: int | None = None

    @property
    def label(self) -> str:
        """Name in words, without the unit."""
        return ABBREVIATIONS.sub(lambda each: each[0].upper(), self.meaning or self.key.replace("_", " "))

    @property
    def shown_unit(self) -> str:
        """Unit in readable form: ``deg/√h``."""
        return shown_unit(self.unit)

    def scaled(self, value: Value) -> Any:
        """Convert a value from SI to the display unit; texts, flags and None stay unchanged."""
        factor = _factor(self.unit)
        return value if factor == 1.0 else _mapped(value, lambda each: each / factor)

    def facts(self) -> dict[str, Any]:
        """Convert value, standard deviation and interval for JSON, with the unit in every key.

        Examples
        --------
        >>> Quantity("delay", 0.128, "ms", sd=0.002).facts()
        {'delay_ms': 128.0, 'delay_sd_ms': 2.0}
        """
        end = key_suffix(self.unit)
        facts = {f"{self.key}{end}": self.scaled(self.value)}
        if self.sd is not None:
            facts[f"{self.key}_sd{end}"] = self.scaled(self.sd)
        if self.interval is not None:
            facts[f"{self.key}_interval{end}"] = [self.scaled(float(bound)) for bound in self.interval]
        return facts


def key_suffix(unit: str) -> str:
    """Convert a unit to a key ending: ``_deg_sqrt_h`` for ``deg/sqrt(h)``, empty without unit."""
    words = re.sub(r"[^0-9A-Za-z]+", "_", unit.replace("^", "").replace("%", "percent")).strip("_")
    return f"_{words.lower() if words not in ('V', 'mV', 'K') else words}" if words and words != "1" else ""


_SUFFIXES = {key_suffix(unit): unit for unit in UNITS}


def quantity_of(key: str, value: Any) -> Quantity:
    """Build a quantity from a key that ends in the unit, such as ``gyro_bias_deg_h``, and the value in this unit.

    Examples
    --------
    >>> quantity_of("speed_m_s", 2.0).facts()
    {'speed_m_s': 2.0}
    """
    suffix = max((ending for ending in _SUFFIXES if ending and key.endswith(ending)), key=len, default="")
    unit = _SUFFIXES[suffix] if suffix else ""
    factor = _factor(unit)
    return Quantity(
        key.removesuffix(suffix), value if factor == 1.0 else _mapped(value, lambda each: each * factor), unit
    )


def _factor(unit: str) -> float:
    return UNITS[unit][1] if unit in UNITS else 1.0


def _mapped(value: Any, function: Callable[[Any], Any]) -> Any:
    """Apply a function to every number in a value."""
    if value is None or isinstance(value, str | bool):
        return value
    if isinstance(value, Mapping):
        return {name: _mapped(item, function) for name, item in value.items()}
    if isinstance(value, float | int):
        return function(value)
    if len(value) and isinstance(value[0], str):
        return value
    return function(np.asarray(value, dtype=np.float64))
