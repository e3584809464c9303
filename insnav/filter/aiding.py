"""What helps the filter besides fixes: wheels, wheel speed, rest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from insnav.types import FloatArray

INTERVAL = 0.25  # from one such measurement to the next [s]


@dataclass(frozen=True, slots=True)
class Wheels:
    """A vehicle on wheels that do not slip: its rear axle moves neither sideways nor up.

    Attributes
    ----------
    to_vehicle : (3, 3) array
        From the axes of the IMU to those of the vehicle.
    lever_b : (3,) array
        A point on the rear axle seen from the IMU, body axes [m].
    sd : (2,) array
        Standard deviation of the velocity to the right and down [m/s], as noise that is new every `INTERVAL`.
    slowest : float
        Below this speed nothing is said [m/s].
    """

    to_vehicle: FloatArray
    lever_b: FloatArray
    sd: FloatArray
    slowest: float = 2.0


@dataclass(frozen=True, slots=True)
class Odometer:
    """Wheel speed over time.

    Attributes
    ----------
    time, speed : (n,) array
        Times [s] and speed with the scale factor taken off [m/s]; ``NaN`` where there is none.
    sd : float
        Standard deviation [m/s], as noise that is new every `INTERVAL`.
    """

    time: FloatArray
    speed: FloatArray
    sd: float


@dataclass(frozen=True, slots=True)
class HeightAid:
    """Height over time, of a barometer or as assumed.

    Attributes
    ----------
    time, height : (n,) array
        Times [s] and height above the ellipsoid [m]; before the first and after the last it stays as there.
    sd : float
        Standard deviation [m], as noise that is new every `INTERVAL`.
    """

    time: FloatArray
    height: FloatArray
    sd: float


@dataclass(frozen=True, slots=True)
class Aiding:
    """Everything that helps; what is absent is not used.

    Attributes
    ----------
    wheels : Wheels or None
    odometer : Odometer or None
        Needs `wheels` for the axes.
    height : HeightAid or None
    rests : (k, 2) array
        Begin and end of the stretches at rest [s].
    rest_velocity_sd : float
        Velocity at rest [m/s].
    rest_rate_sd : (3,) array
        Standard deviation of the mean gyro output over `INTERVAL` at rest [rad/s].
    """

    wheels: Wheels | None = None
    odometer: Odometer | None = None
    rests: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    rest_velocity_sd: float = 0.02
    rest_rate_sd: FloatArray = field(default_factory=lambda: np.full(3, np.inf))
    height: HeightAid | None = None

    def resting(self, begin: float, end: float) -> bool:
        """Whether the vehicle is at rest from `begin` to `end` [s]."""
        row = int(np.searchsorted(self.rests[:, 0], begin, side="right")) - 1
        return row >= 0 and end <= float(self.rests[row, 1])
