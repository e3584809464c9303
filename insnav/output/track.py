"""A trajectory with its dates, as the formats of other programs need it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insnav.exceptions import ConfigError
from insnav.types import FloatArray, Trajectory
from insnav.units import DEG


@dataclass(frozen=True, slots=True)
class Track:
    """A trajectory to be written."""

    trajectory: Trajectory
    name: str
    utc: NDArray[np.datetime64] | None  # (n,) instants in UTC and in GPS time [ns]; None if no date is known
    gps: NDArray[np.datetime64] | None
    height: str  # ``ellipsoidal`` or ``msl``

    @property
    def degrees(self) -> FloatArray:
        """Latitude, longitude within 180 [deg], height [m], (n, 3)."""
        lla = self.trajectory.lla / np.array([DEG, DEG, 1.0])
        lla[:, 1] = (lla[:, 1] + 180.0) % 360.0 - 180.0
        return np.asarray(lla, dtype=np.float64)

    @property
    def sd(self) -> FloatArray:
        """Standard deviations of position and velocity, (n, 6); NaN where not known."""
        sd = self.trajectory.sd
        return np.full((len(self.trajectory.time), 6), np.nan) if sd is None else sd[:, :6]

    def instants(self, of: str) -> NDArray[np.datetime64]:
        """Instants in ``utc`` or ``gps``.

        Raises: ConfigError: no date is known.
        """
        found: NDArray[np.datetime64] | None = getattr(self, of)
        if found is None:
            raise ConfigError("output.no_date", where="--week", begin_s=float(self.trajectory.time[0]))
        return found
