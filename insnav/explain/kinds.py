"""Kinds of faults: each is a step of a few states, with a rate and a typical size.

A fault is a step of unknown size in the state of the linear record (P. de Jong, J. Penzer, "Diagnosing shocks in time
series", J. Am. Stat. Assoc. 93 (1998) 796-806). The prior of a kind has two parameters. The rate is the number of
begins per hour. The size of a fault is log-normal about the typical size.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from insnav.config_file import Table, read_toml, scalar, validate, with_fields
from insnav.types import FloatArray
from insnav.units import DEG, UNITS

HOUR = 3600.0  # seconds in an hour [s]
SPREAD = 1.2  # standard deviation of the logarithm of a size: a factor of 3.3 [-]
ENDS = 60.0  # rate of the end of a temporary fault: faults last a minute on average [1/h]
UNITS_OF = {  # unit of the displayed size, by the name of the state that steps
    **{"offset": "m", "drift": "m/s", "velocity": "m/s", "velocity offset": "m/s", "attitude": "deg"},
    **{"gyro": "deg/s", "accel": "m/s^2", "delay": "s"},
}
FADES = 45.0  # correlation time of multipath: half a minute to a minute for a vehicle in a town [s]


@dataclass(frozen=True, slots=True)
class Kind:
    """Kind of faults: the states that step, and the prior of rate and size."""

    name: str
    steps: tuple[tuple[str, ...], ...]  # one tuple for each column: the states that step together
    rate: float  # number of begins per hour [1/h]
    size: float  # typical size, in the unit of the states
    of_fixes: bool  # true for a fault of the fixes, false for a fault of the IMU
    passes: bool = True  # true if the fault may end
    fills: bool = False  # true for noise at every epoch of an interval, false for one step

    @property
    def unit(self) -> str:
        """Unit of the displayed size."""
        return UNITS_OF[self.steps[0][0].rsplit(" ", 1)[0]] if self.steps else ""

    def cost(self, variance: FloatArray | float, interval: float) -> FloatArray:
        """Compute -2 ln of the prior of a step at one epoch [-], by its rate and its log-normal size.

        `interval`: between epochs [s]. The constant of the density and the width of its peak nearly cancel: omit both.
        """
        if not self.steps:
            return np.asarray(cost_of_end(interval))
        size = 0.5 * np.log(np.maximum(variance, 1e-30) / self.size**2)
        return np.asarray(-2.0 * np.log(self.rate * interval / HOUR) + (size / SPREAD) ** 2)


def cost_of_end(interval: float) -> float:
    """Compute -2 ln of the prior probability that a fault ends at one epoch [-]. `interval`: between epochs [s]."""
    return float(-2.0 * np.log(ENDS * interval / HOUR))


def _axes(name: str) -> tuple[tuple[str, ...], ...]:
    return tuple((f"{name} {axis}",) for axis in range(3))


_FOLLOWED = tuple((f"drift {axis}", f"velocity offset {axis}") for axis in range(3))
KINDS: tuple[Kind, ...] = (
    Kind("offset", _axes("offset"), 1.0, 10.0, True),
    Kind("drag", _axes("drift"), 0.2, 0.5, True),
    Kind("followed_drag", _FOLLOWED, 0.2, 0.5, True),
    Kind("velocity_offset", _axes("velocity offset"), 0.3, 1.0, True),
    Kind("rough", _axes("offset"), 0.3, 1.0, True, fills=True),
    Kind("velocity", _axes("velocity"), 0.1, 1.0, False, passes=False),
    Kind("turned", _axes("attitude"), 0.05, 0.1, False),
    Kind("heading", (("attitude 2",),), 0.05, 0.1, False),
    *(Kind(f"gyro_{'xyz'[i]}", ((f"gyro {i}",),), 0.03, 0.6 * DEG, False) for i in range(3)),
    *(Kind(f"accel_{'xyz'[i]}", ((f"accel {i}",),), 0.03, 0.2, False) for i in range(3)),
    Kind("delay", (("delay 0",),), 0.1, 0.2, True, passes=False),
)
# return of displaced fixes to the true track, which ends an earlier fault at a separate epoch
RETURN = Kind("return", (), ENDS, 1.0, True, passes=False)


class _Priors(Table):
    """Rate and size of a kind, as specified by the user."""

    above_zero = ("rate", "size")


def with_priors(given: str | Path | Mapping[str, Any]) -> tuple[Kind, ...]:
    """Return all kinds, with the rates and sizes that the user specifies.

    `given`: ``{"offset": {"rate": "0.2 1/h", "size": "30 m"}}``, or a TOML file with such tables in ``faults``.
    Raises: ConfigError: the file cannot be read; no kind has this name; a figure is not positive, or no quantity.
    """
    data = {"faults": dict(given)} if isinstance(given, Mapping) else read_toml(Path(given))
    rate = scalar("frequency")
    tables = {each.name: with_fields(_Priors, {"rate": rate, "size": scalar(UNITS[each.unit][0])}) for each in KINDS}
    model = with_fields(Table, {"faults": with_fields(Table, tables)})
    chosen = validate(model, data, "" if isinstance(given, Mapping) else str(given)).model_dump()["faults"] or {}
    priors = ((kind, chosen.get(kind.name) or {}) for kind in KINDS)
    return tuple(
        replace(kind, rate=HOUR * (prior.get("rate") or kind.rate / HOUR), size=prior.get("size") or kind.size)
        for kind, prior in priors
    )
