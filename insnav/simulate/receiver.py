"""Errors of satellite receivers: noise that is white, noise that lasts, and outages."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insnav.earth import lla_offset
from insnav.exceptions import ConfigError
from insnav.simulate.sensors import Seed, gauss_markov
from insnav.types import FloatArray, GpsData

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class GpsErrors:
    """How far the fixes of a receiver are off.

    Attributes
    ----------
    position_noise : (3,) tuple
        Standard deviation of the white error North, East, Down [m].
    position_drift : (3,) tuple
        Standard deviation of the time-correlated (first-order Gauss-Markov) error North, East, Down [m].
    correlation_time : float
        Its correlation time [s].
    velocity_noise : (3,) tuple
        Standard deviation of the white velocity error [m/s].
    """

    position_noise: Triple
    position_drift: Triple = (0.0, 0.0, 0.0)
    correlation_time: float = 60.0
    velocity_noise: Triple = (0.1, 0.1, 0.1)

    @property
    def position_sd(self) -> FloatArray:
        """Standard deviation of the whole position error North, East, Down ``(3,)`` [m]."""
        return np.hypot(self.position_noise, self.position_drift)


def corrupt_gps(gps: GpsData, errors: GpsErrors, seed: Seed) -> GpsData:
    """Add errors, and standard deviations that tell their true size.

    Parameters
    ----------
    gps : GpsData
        Error-free fixes.
    errors : GpsErrors
        Sizes of the errors.
    seed : int or tuple of int
        The same seed gives the same errors.

    Returns
    -------
    GpsData
        The same fixes with errors.

    Raises
    ------
    ConfigError
        A standard deviation that is not above zero: no receiver is perfect, and no filter takes a zero.
    """
    velocity_sd = np.asarray(errors.velocity_noise, dtype=np.float64)
    sizes = np.concatenate([errors.position_sd, velocity_sd, [errors.correlation_time]])
    if not (np.all(np.isfinite(sizes)) and np.all(sizes > 0.0)):
        raise ConfigError(
            "standard deviations and correlation time of the receiver must be above zero",
            where="gps",
            why=f"they are {errors.position_sd} m, {velocity_sd} m/s and {errors.correlation_time} s",
        )
    rng = np.random.default_rng(seed)
    shape = gps.lla.shape
    error_n = rng.standard_normal(shape) * errors.position_noise
    error_n += gauss_markov(rng, gps.time, np.array(errors.position_drift), errors.correlation_time)
    return replace(
        gps,
        lla=lla_offset(gps.lla, error_n),
        v_n=gps.v_n + rng.standard_normal(shape) * velocity_sd,
        position_sd=np.tile(errors.position_sd, (shape[0], 1)),
        velocity_sd=np.tile(velocity_sd, (shape[0], 1)),
    )


def without_fixes(gps: GpsData, begin: float, end: float) -> GpsData:
    """Take out the fixes of an outage, at ``begin < time <= end`` [s]."""
    kept = ~((gps.time > begin) & (gps.time <= end))
    return replace(
        gps,
        time=gps.time[kept],
        lla=gps.lla[kept],
        v_n=gps.v_n[kept],
        position_sd=gps.position_sd[kept],
        velocity_sd=gps.velocity_sd[kept],
        fix=None if gps.fix is None else gps.fix[kept],
        heading=None if gps.heading is None else gps.heading[kept],
    )
