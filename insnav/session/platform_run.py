"""A record of specific force on a north-pointing platform: read, and integrated by every integrator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from insnav.exceptions import ConfigError, InputError
from insnav.gimbal import INTEGRATORS, Integrator, PlatformErrors, PlatformRun, Vertical, navigate_platform
from insnav.input import Reading, ReadingFacts, read_reference
from insnav.input.readers.heights import Heights, read_heights
from insnav.input.readers.specific_force import SpecificForce, read_specific_force
from insnav.session.read import one_from_stdin
from insnav.types import FloatArray, Trajectory
from insnav.units import DEG


@dataclass(frozen=True, slots=True)
class PlatformRecord:
    """What was read."""

    force: Reading[SpecificForce]
    height: Reading[Heights] | None = None  # heights to damp the vertical channel with
    reference: Reading[Trajectory] | None = None

    @property
    def facts(self) -> dict[str, ReadingFacts]:
        """What was understood of each."""
        named = {"force": self.force, "height": self.height, "ref": self.reference}
        return {name: each.facts for name, each in named.items() if each is not None}


@dataclass(frozen=True, slots=True)
class PlatformStart:
    """State at the start."""

    # [rad]
    lat: float
    lon: float
    height: float = 0.0  # [m]
    v_n: tuple[float, float, float] = (0.0, 0.0, 0.0)  # North, East, Down [m/s]

    def __post_init__(self) -> None:
        limits = (
            ("--lat", self.lat / DEG, -90.0, 90.0, "deg, north positive"),
            ("--lon", self.lon / DEG, -180.0, 360.0, "deg, east positive"),
            ("--height", self.height, -1e5, 1e5, "m"),
            *(
                (name, each, -1e4, 1e4, "m/s")
                for name, each in zip(("--v-north", "--v-east", "--v-up"), self.v_n, strict=True)
            ),
        )
        for option, value, low, high, unit in limits:
            if not low <= value <= high:  # NaN is not within either
                what = {"--lat": "latitude", "--lon": "longitude"}.get(option, "sensible value")
                raise ConfigError(f"{value:g} is not a {what}", where=option, fix=f"{low:g} to {high:g} {unit}")


def read_platform(
    force: str | Path,
    *,
    height: str | Path | None = None,
    ref: str | Path | None = None,
    axes: Literal["ENU", "NED"] | None = None,
    columns: Mapping[str, str] | None = None,
    sample_rate: float | None = None,
) -> PlatformRecord:
    """Read specific force along level axes, and what goes with it.

    `axes`, `columns`, `sample_rate`: as in `insnav.input.readers.specific_force.read_specific_force`.
    Raises: ConfigError, InputError: what cannot be meant, or used.
    """
    if sample_rate is not None and not 0.1 <= sample_rate <= 1e5:
        raise ConfigError(
            f"{sample_rate:g} is not a rate", where="--sample-rate", fix="write samples per second, such as 100"
        )
    one_from_stdin({"FORCE_FILE": force, "--height-input": height, "--ref": ref})
    heights = None if height is None else read_heights(height)
    reference = None if ref is None else read_reference(ref)
    return PlatformRecord(
        read_specific_force(force, axes=axes, columns=columns, sample_rate=sample_rate), heights, reference
    )


def integrate(
    record: PlatformRecord,
    start: PlatformStart,
    errors: PlatformErrors,
    *,
    vertical: Vertical = "off",
    gravity: float | None = None,
    interval: float = 0.1,
) -> dict[Integrator, PlatformRun]:
    """Integrate a record by every integrator.

    `vertical` {"off", "free", "damped"}: vertical channel; `gravity`: of this size everywhere and straight down
    [m/s^2]; by default normal gravity; `interval`: time between rows of the solutions [s].
    Raises: InputError: no vertical axis, or heights that do not cover the record.
    """
    if gravity is not None and not 9.5 < gravity < 10.0:  # NaN is not within either
        raise ConfigError(f"{gravity:g} m/s² is not gravity on the Earth", where="--gravity", fix="9.5 to 10 m/s²")
    time, f_n = record.force.data.time, record.force.data.f_n
    if vertical != "off" and np.isnan(f_n[:, 2]).all():
        raise InputError(
            "there is no vertical axis",
            where=record.force.facts.path,
            why=f"--vertical {vertical} integrates f_up_m_s2 or f_down_m_s2",
            fix="use --vertical off",
        )
    lla = np.array([start.lat, (start.lon + np.pi) % (2.0 * np.pi) - np.pi, start.height])
    height = None if record.height is None else _heights(record.height.data, time)
    every = max(1, round(interval / float(np.median(np.diff(time)))))
    return {
        name: navigate_platform(
            time,
            f_n,
            lla,
            np.array(start.v_n),
            integrator=name,
            vertical=vertical,
            height=height,
            errors=errors,
            gravity=gravity,
            every=every,
        )
        for name in INTEGRATORS
    }


def _heights(given: Heights, time: FloatArray) -> FloatArray:
    """Height at the times of the samples."""
    if not (given.time[0] <= time[0] and time[-1] <= given.time[-1]):
        raise InputError(
            "the height input does not cover the record",
            where="--height-input",
            why=f"heights from {given.time[0]:.3f} to {given.time[-1]:.3f} s, samples from {time[0]:.3f} to "
            f"{time[-1]:.3f} s",
            fix="give heights for the whole record, in the same time",
        )
    return np.interp(time, given.time, given.height)
