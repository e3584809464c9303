"""Layout of the filter's optional states, and their initial covariance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from insnav.attitude import dcm_from_rph, quat_from_rph
from insnav.filter.error_model import FilterState, InitialState
from insnav.filter.settings import FilterSettings
from insnav.kernels.errorstate import STATES
from insnav.types import FloatArray


class Layout(NamedTuple):
    """Number of states, and the first index of each optional group; -1 if absent."""

    states: int
    delay: int
    correlated: int
    """States of the time-correlated GPS error: three of position, and three of velocity if modelled."""
    lever: int
    """Three states of the lever arm, body axes."""
    shaken: int
    """Three states of the lever arm by which vibration moves the antenna for the receiver.

    A receiver measures velocity over its own 20 to 200 ms, and vibration of the IMU need not move the antenna.
    """
    lag: int
    """Of the velocities of fixes behind their positions."""

    @property
    def has_arm(self) -> bool:
        """Return whether turns determine an estimated lever arm."""
        return self.lever >= 0 or self.shaken >= 0


def layout(settings: FilterSettings) -> Layout:
    """Lay out the states for the settings; states after the delay need its place, if only as a known zero."""
    swings = settings.shaken > 0.0 and (settings.lever_sd > 0.0 or settings.lever_b.any())
    more = settings.correlated is not None or settings.lever_sd > 0.0 or settings.lag_sd > 0.0 or swings
    if not more and settings.delay_sd <= 0.0:
        return Layout(STATES, -1, -1, -1, -1, -1)
    count = STATES + 1
    correlated = lever = shaken = lag = -1
    if settings.correlated is not None:
        correlated, count = count, count + settings.correlated.sds.size
    if settings.lever_sd > 0.0:
        lever, count = count, count + 3
    if swings:
        shaken, count = count, count + 3
    if settings.lag_sd > 0.0:
        lag, count = count, count + 1
    return Layout(count, STATES, correlated, lever, shaken, lag)


def first_state(start: InitialState, settings: FilterSettings) -> FilterState:
    """Build the initial state and covariance of all states for the settings."""
    at = layout(settings)
    covariance = np.zeros((at.states, at.states))
    covariance[:STATES, :STATES] = start.covariance
    if at.delay >= 0:
        covariance[at.delay, at.delay] = settings.delay_sd**2
    if settings.correlated is not None:
        reset_correlated(covariance, at.correlated, settings.correlated.sds)
    arms = [slice(first, first + 3) for first in (at.lever, at.shaken) if first >= 0]
    for part in arms:
        for other in arms:
            covariance[part, other] = settings.lever_sd**2 * np.eye(3)
    if at.shaken >= 0:
        covariance[part, part] += settings.shaken**2 * np.eye(3)
    if at.lag >= 0:
        covariance[at.lag, at.lag] = settings.lag_sd**2
    if start.from_fix and at.delay >= 0:
        if settings.correlated is not None:
            cross_covariance(covariance, at.correlated, settings.correlated.sd)
        by = set_to_fix(at, start.v_n, dcm_from_rph(start.rph))
        covariance = by @ covariance @ by.T
    x = np.concatenate([start.lla, start.v_n, quat_from_rph(start.rph)])
    correction = np.concatenate([start.gyro_bias, np.zeros(9)])
    levers = settings.lever_b.copy(), settings.lever_b.copy()
    lasting = np.zeros(3 if settings.correlated is None else settings.correlated.sds.size)
    return FilterState(start.time, x, correction, 0.0, settings.velocity_lag, lasting, *levers, np.zeros(6), covariance)


def set_to_fix(at: Layout, v_n: FloatArray, c: FloatArray) -> FloatArray:
    """Return the error mapping (n, n) of setting a position to a fix, at a velocity (3,) [m/s] and ``C_nb`` (3, 3)."""
    by = np.eye(at.states)
    if at.delay >= 0:
        by[:3, at.delay] = v_n
    if at.lever >= 0:
        by[:3, at.lever : at.lever + 3] = -c
    return by


def reset_correlated(covariance: FloatArray, at: int, sd: FloatArray) -> None:
    """Reset the time-correlated GPS error to its own standard deviation."""
    part = slice(at, at + sd.size)
    covariance[part, :] = covariance[:, part] = 0.0
    covariance[part, part] = np.diag(sd**2)


def cross_covariance(covariance: FloatArray, at: int, sd: FloatArray) -> None:
    """Correlate a position, or position and velocity, that was set to a fix with the fix's time-correlated error.

    The position error equals the error of the fix, and the state compensates it: their covariance is ``-sd^2``. The
    position variance is slightly larger, so that the matrix stays positive.
    """
    for i in range(sd.size):
        covariance[i, i] = max(covariance[i, i], 1.0001 * sd[i] ** 2)
        covariance[i, at + i] = covariance[at + i, i] = -(sd[i] ** 2)
