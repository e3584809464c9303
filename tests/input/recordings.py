"""One known motion, to be written in every format: a level car that goes round at constant speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pymap3d
import pytest

from tests.input.files import SHARED, G

REAL = SHARED / "data" / "formats"
real = pytest.mark.skipif(not REAL.is_dir(), reason="real recordings (../shared/data/formats) are not here")

PLACE = (-33.25, 151.5, 80.0)  # latitude, longitude [deg], height [m]
RADIUS, TURN = 40.0, 0.25  # [m], [rad/s]
WEEK, TOW = 2381, 302_400.0  # Wednesday noon, in August 2025: 18 leap seconds
GPS_UNIX = 315_964_800
UNIX = GPS_UNIX + WEEK * 604_800 + TOW - 18.0  # the same instant


@dataclass(frozen=True)
class Motion:
    """Truth at times `t` after the start [s]."""

    t: np.ndarray

    @property
    def lla(self) -> np.ndarray:
        """Latitude, longitude [deg], height [m]; (n, 3)."""
        angle = TURN * self.t
        ned = (RADIUS * np.sin(angle), RADIUS * (1.0 - np.cos(angle)), np.zeros_like(angle))
        return np.column_stack(pymap3d.ned2geodetic(*ned, *PLACE))

    @property
    def v_n(self) -> np.ndarray:
        """Velocity North, East, Down [m/s]; (n, 3)."""
        angle, speed = TURN * self.t, RADIUS * TURN
        return np.column_stack([speed * np.cos(angle), speed * np.sin(angle), np.zeros_like(angle)])

    @property
    def heading(self) -> np.ndarray:
        """Clockwise from north [deg]."""
        return np.degrees(TURN * self.t) % 360.0

    @property
    def gyro(self) -> np.ndarray:
        """Rates of the body [rad/s]; (n, 3)."""
        return np.tile([0.0, 0.0, TURN], (len(self.t), 1))

    @property
    def accel(self) -> np.ndarray:
        """Specific force [m/s^2]; (n, 3)."""
        return np.tile([0.0, RADIUS * TURN**2, -G], (len(self.t), 1))


FIXES = Motion(0.2 * np.arange(40))
SAMPLES = Motion(0.01 * np.arange(820))


def same_places(data, motion: Motion = FIXES, metres: float = 0.02) -> bool:
    """Whether positions are those of the motion."""
    lla = np.column_stack([np.degrees(data.lla[:, :2]), data.lla[:, 2]])
    ned = pymap3d.geodetic2ned(*lla.T, *motion.lla.T)
    return float(np.max(np.abs(ned))) < metres
