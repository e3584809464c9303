"""Which states the filter has beyond those of every filter, and what it begins with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from insnav.attitude import quat_from_rph
from insnav.filter.error_model import FilterState, InitialState
from insnav.filter.settings import FilterSettings
from insnav.kernels.errorstate import STATES
from insnav.types import FloatArray


class Layout(NamedTuple):
    """Where the states stand; -1 for those that are not there.

    Attributes
    ----------
    states : int
        Number of states.
    delay : int
        GPS delay.
    lasting : int
        First of the three of a position error that lasts.
    lever : int
        First of the three of the lever arm, body axes.
    """

    states: int
    delay: int
    lasting: int
    lever: int


def layout(settings: FilterSettings) -> Layout:
    """States that the settings ask for; whatever follows the delay needs its place, if only as a known zero."""
    more = settings.correlated is not None or settings.lever_sd > 0.0
    if not more and settings.delay_sd <= 0.0:
        return Layout(STATES, -1, -1, -1)
    count = STATES + 1
    lasting = lever = -1
    if settings.correlated is not None:
        lasting, count = count, count + 3
    if settings.lever_sd > 0.0:
        lever, count = count, count + 3
    return Layout(count, STATES, lasting, lever)


def first_state(start: InitialState, settings: FilterSettings) -> FilterState:
    """State to begin with: all the states that the settings ask for.

    Parameters
    ----------
    start : InitialState
        Position, velocity, attitude and the covariance of the 21 states of every filter.
    settings : FilterSettings
        What else is to be estimated.
    """
    at = layout(settings)
    covariance = np.zeros((at.states, at.states))
    covariance[:STATES, :STATES] = start.covariance
    if at.delay >= 0:
        covariance[at.delay, at.delay] = settings.delay_sd**2
    if settings.correlated is not None:
        set_lasting(covariance, at.lasting, settings.correlated.sd)
    if at.lever >= 0:
        part = slice(at.lever, at.lever + 3)
        covariance[part, part] = settings.lever_sd**2 * np.eye(3)
    if start.from_fix and at.delay >= 0:
        # the position is that of a fix: as far off as the vehicle went in the delay, and by what lasts of its error
        if settings.correlated is not None:
            tie(covariance, at.lasting, settings.correlated.sd)
        covariance[:3, :3] += settings.delay_sd**2 * np.outer(start.v_n, start.v_n)
        covariance[:3, at.delay] = covariance[at.delay, :3] = settings.delay_sd**2 * start.v_n
        if at.lever >= 0:
            # and by what the lever arm is wrong; the direction hardly matters
            covariance[:3, :3] += settings.lever_sd**2 * np.eye(3)
    x = np.concatenate([start.lla, start.v_n, quat_from_rph(start.rph)])
    correction = np.concatenate([start.gyro_bias, np.zeros(9)])
    return FilterState(start.time, x, correction, 0.0, np.zeros(3), settings.lever_b.copy(), np.zeros(6), covariance)


def set_lasting(covariance: FloatArray, at: int, sd: FloatArray) -> None:
    """Forget what is known of a position error that lasts: only its own standard deviation is left."""
    part = slice(at, at + 3)
    covariance[part, :] = covariance[:, part] = 0.0
    covariance[part, part] = np.diag(sd**2)


def tie(covariance: FloatArray, at: int, sd: FloatArray) -> None:
    """Covariance of a position set to a fix with the part of its error that lasts: what one gains the other lacks."""
    for i in range(3):
        covariance[i, i] = max(covariance[i, i], 1.0001 * sd[i] ** 2)
        covariance[i, at + i] = covariance[at + i, i] = -(sd[i] ** 2)
