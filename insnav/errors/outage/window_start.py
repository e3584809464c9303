"""What a window starts from, and what the filter says of its first state: the prediction before anything happens."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from insnav.attitude import dcm_from_quat
from insnav.earth import gravity_n
from insnav.filter.error_model import ErrorModel, FilterState
from insnav.filter.settings import FilterSettings
from insnav.filter.state_layout import layout
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import STATES
from insnav.types import FloatArray, Run

StartChoice = Literal["forward", "smoothed"]


def alone(settings: FilterSettings, *, withheld: bool) -> FilterSettings:
    """Settings of a filter that goes on without fixes, wheels, rest or anything else.

    Parameters
    ----------
    settings : FilterSettings
        Of the drive.
    withheld : bool
        It is compared with the fixes of the drive, whose velocities may lag.
    """
    return replace(
        settings,
        correlated=None,
        lever_sd=0.0,
        jitter=0.0,
        velocity_lag=settings.velocity_lag if withheld else 0.0,
        heading_sd=0.0,
        aiding=None,
        smooth=False,
        output_interval=1e9,
    )


def forward_start(state: FilterState, settings: FilterSettings, lever_b: FloatArray | None) -> FilterState:
    """State of the forward filter, with all fixes before it, as the start of a window.

    Parameters
    ----------
    state : FilterState
        As kept by the filter of the drive.
    settings : FilterSettings
        Of the window, from `alone`.
    lever_b : (3,) array or None
        Point that is judged, seen from the IMU [m]; None for the antenna.
    """
    n = layout(settings).states
    return replace(
        state,
        covariance=state.covariance[:n, :n].copy(),
        lasting=np.zeros(3),
        lever_b=state.lever_b.copy() if lever_b is None else lever_b.copy(),
    )


def uncalibrated(start: FilterState, model: ErrorModel) -> FilterState:
    """The same start with no sensor error taken off: the sensors as they were turned on.

    The filter's estimates and their errors are uncorrelated, as those of a least mean-square estimate are if what it
    was told to begin with is right; so the error of taking none off is as large as the turn-on figures say, and goes
    with position, velocity and attitude as the error of the estimate did.

    Parameters
    ----------
    start : FilterState
        From `forward_start`.
    model : ErrorModel
        With the turn-on figures of the IMU.
    """
    covariance = start.covariance.copy()
    sensors = slice(NAV, STATES)
    covariance[sensors, sensors] = np.diag(np.maximum(model.sd**2, np.diag(covariance[sensors, sensors])))
    return replace(start, correction=np.zeros(STATES - NAV), covariance=covariance)


def smoothed_start(start: FilterState, run: Run, clock: float) -> FilterState | None:
    """The start with what the whole drive, later fixes included, says of it; None where no fix was used.

    Position, velocity and attitude keep their covariance, sensor errors their variances; how they go together is not
    kept, so that the prediction is somewhat too large.

    Parameters
    ----------
    start : FilterState
        From `forward_start`.
    run : Run
        The drive, smoothed.
    clock : float
        Time of the run minus that of the samples [s].
    """
    assert run.smoothed is not None
    epochs, sensors = run.smoothed.epochs, run.smoothed.sensor_errors
    at = int(np.searchsorted(epochs.time - clock, start.time - 1e-6))
    if at >= len(epochs.time) or abs(epochs.time[at] - clock - start.time) > 1e-6:
        return None
    covariance = np.zeros_like(start.covariance)
    covariance[:NAV, :NAV] = epochs.covariance[at]
    covariance[NAV:STATES, NAV:STATES] = np.diag(sensors.sd[at] ** 2)
    if covariance.shape[0] > STATES:
        covariance[STATES, STATES] = run.gps_delay_sd**2
    x = np.concatenate([epochs.lla[at], epochs.v_n[at], epochs.q_nb[at]])
    return replace(start, x=x, correction=sensors.value[at].copy(), delay=clock, covariance=covariance)


def effective(q_nb: FloatArray, lla: FloatArray) -> FloatArray:
    """How errors of a first state show in the growth that follows.

    A level vehicle that does not turn: velocity error, effective horizontal acceleration ``g x phi - C db`` and its
    change ``g x C dw``, for estimate minus truth with ``C_hat = (I - [phi x]) C`` (Groves 2013, section 5.7).

    Parameters
    ----------
    q_nb : (4,) array
        Attitude at the start.
    lla : (3,) array
        Where [rad], [rad], [m].

    Returns
    -------
    (2, 3, 21) array
        For North and East: velocity [m/s], acceleration [m/s^2], jerk [m/s^3] by the 21 errors of the filter.
    """
    c = dcm_from_quat(q_nb)
    g = float(gravity_n(lla[0], lla[2])[2])
    out = np.zeros((2, 3, STATES))
    for axis, other, sign in ((0, 1, 1.0), (1, 0, -1.0)):
        out[axis, 0, 3 + axis] = 1.0
        out[axis, 1, 6 + other] = sign * g
        out[axis, 1, 12:15] = -c[axis]
        out[axis, 2, 9:12] = sign * g * c[other]
    return out
