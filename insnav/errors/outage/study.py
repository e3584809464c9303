"""GNSS outages all over a drive, their errors summed up, and all of their epochs in one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from insnav.errors.outage.gnss_outage import Outage
from insnav.errors.outage.statistics import Growth
from insnav.tabular import Tabular
from insnav.types import FloatArray


@dataclass(frozen=True, slots=True)
class OutageStudy:
    """Windows without fixes."""

    windows: tuple[Outage, ...]  # in order of length, then of time
    growth: tuple[Growth, ...]  # their errors, summed up by length
    reference: str  # what errors are against, in words


_STATES = ("north_m", "east_m", "down_m", "v_north_m_s", "v_east_m_s", "v_down_m_s")


@dataclass(frozen=True, slots=True)
class OutageEpochs(Tabular):
    """All epochs of all windows, one after the other; fields as in `Outage`, those of a window in each of its rows."""

    COLUMNS: ClassVar = {
        "start": ("start_time_s",),
        "length": ("length_time_s",),
        "elapsed": ("time_s",),
        "error": tuple(f"error_{name}" for name in _STATES),
        "sd": tuple(f"sd_{name}" for name in _STATES),
        "smoothed": tuple(f"smoothed_{name}" for name in _STATES),
        "smoothed_sd": tuple(f"smoothed_sd_{name}" for name in _STATES),
        "reference_sd": tuple(f"reference_sd_{name}" for name in _STATES),
        "heading": ("heading_deg",),
        "heading_sd": ("heading_sd_deg",),
        "speed": ("speed_m_s",),
    }

    start: FloatArray  # (m,) [s]
    length: FloatArray  # (m,) [s]
    elapsed: FloatArray  # (m,) [s]
    # (m, 6) [m], [m/s]
    error: FloatArray
    sd: FloatArray
    smoothed: FloatArray
    smoothed_sd: FloatArray
    reference_sd: FloatArray
    # (m,) [rad]
    heading: FloatArray
    heading_sd: FloatArray
    speed: FloatArray  # (m,) [m/s]

    @classmethod
    def of(cls, windows: Sequence[Outage]) -> OutageEpochs:
        """All epochs of some windows."""
        columns = {}
        for name in cls.COLUMNS:
            parts = [(getattr(each, name), len(each.elapsed)) for each in windows]
            columns[name] = np.concatenate([np.full(n, v) if np.ndim(v) == 0 else v for v, n in parts])
        return cls(**columns)

    def windows(self) -> tuple[Outage, ...]:
        """The windows again, as they were in order."""
        begins = np.flatnonzero((np.diff(self.start) != 0.0) | (np.diff(self.length) != 0.0)) + 1
        edges = [0, *begins.tolist(), len(self.start)]
        found = []
        for first, last in pairwise(edges):
            part: dict[str, Any] = {name: getattr(self, name)[first:last] for name in self.COLUMNS}
            once: dict[str, Any] = {name: float(part.pop(name)[0]) for name in ("start", "length", "speed")}
            found.append(Outage(**part, **once))
        return tuple(found)
