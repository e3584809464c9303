"""Windows of a drive: their times, their filter input, initial states and references."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from insnav.attitude import dcm_from_quat
from insnav.earth import gravity_n
from insnav.exceptions import InputError
from insnav.filter.error_model import ErrorModel, FilterState, layout
from insnav.filter.navigate import feed
from insnav.filter.prepare import Prepared
from insnav.filter.settings import FilterSettings
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import STATES
from insnav.types import BoolArray, FloatArray, GpsData, IntArray, Run, Trajectory

LENGTHS = (5.0, 10.0, 15.0, 30.0, 60.0, 120.0)  # default lengths of GNSS outages [s]
SETTLED = 60.0  # no window starts earlier after the start of navigation, in a long drive [s]
COUNT = 60  # windows with the default spacing
CLOSEST = 2.0  # lower limit of the default spacing [s]
StartChoice = Literal["forward", "smoothed"]
_SOLUTION = 0.1  # output interval of the whole drive: for speed, course and the simulated replica [s]
FirstWindow = Literal["quarter of drive", "half of slack"]
_LEAD = 2.0  # samples before the window, for the polynomials at its first interval [s]
_SAME = 1e-6  # times closer than this are equal [s]


@dataclass(frozen=True, slots=True)
class Outage:
    """Window without fixes, compared with the fixes (or the epochs of a reference) in it."""

    # time of the last fix before it, and length [s]
    start: float
    length: float
    elapsed: FloatArray  # (k,) time since `start` [s]
    # (k, 6) error of position North, East, Down [m] and velocity [m/s], filtered and smoothed; ``NaN`` without a value
    error: FloatArray
    # (k, 6) stated standard deviation of the filter
    sd: FloatArray
    smoothed: FloatArray
    smoothed_sd: FloatArray
    reference_sd: FloatArray  # (k, 6) standard deviation of the fix or reference
    heading: FloatArray  # (k,) heading of the filter minus smoothed heading with all fixes [rad]
    heading_sd: FloatArray  # (k,) standard deviation of the filter's heading [rad]
    speed: float  # mean speed in the window [m/s]


def window_starts(
    fixes: FloatArray,
    begin: float,
    end: float,
    length: float,
    *,
    first: float | None,
    spacing: float | None,
    rule: FirstWindow,
) -> IntArray:
    """Choose the fixes at which windows begin, evenly along a drive.

    `fixes` (n,): times of the fixes, on the IMU clock [s]. `begin`, `end`: of navigation [s]. `length`: of the windows,
    or the shortest of several lengths [s]. `first`: start of the first, after `begin` [s]; by default a minute, or less
    by `rule` on a short drive. `spacing`: between starts [s]; by default about sixty fit. `rule` {"quarter of drive",
    "half of slack"}: settling time on a short drive. A quarter of the drive: windows of several lengths begin at the
    same fixes. Half of the slack of one window: a single long window still fits.
    Returns: (m,): rows of the fixes, increasing.
    Raises: InputError: the drive is too short.
    """
    drive = end - begin
    shared = rule == "quarter of drive"
    if first is None:
        first = min(SETTLED, 0.25 * drive if shared else max(0.0, 0.5 * (drive - length)))
    room = drive - first - length
    if room < -_SAME:
        raise InputError("outage.drive_too_short", length_s=length, drive_s=drive, first_s=first)
    if spacing is None:
        spacing = max(CLOSEST, (drive - first if shared else room) / COUNT)
    wanted = begin + first + np.arange(int((room + _SAME) / spacing) + 1) * spacing
    rows = np.unique(np.searchsorted(fixes, wanted - _SAME))
    rows = rows[rows < len(fixes)]
    return np.asarray(rows[fixes[rows] <= end - length + _SAME])


def part_of(ready: Prepared, state: FilterState, length: float) -> Prepared:
    """Cut the samples that a filter needs to continue for a time.

    `length` [s].
    """
    end = min(state.time + length + _LEAD, ready.unbroken_until(state.time) + _SAME)
    first, last = np.searchsorted(ready.imu.time, [state.time - _LEAD, end])
    return replace(ready, imu=ready.imu.rows(slice(first, last)))


def valid(gps: GpsData) -> BoolArray:
    """Return whether each fix is valid by its type, (n,)."""
    return np.ones(gps.time.shape[0], dtype=np.bool_) if gps.fix is None else np.asarray(gps.fix != 0)


def comparison_only(gps: GpsData, fix: int = 0) -> GpsData:
    """Mark fixes as invalid or `OF_REFERENCE`: a filter only compares itself with them."""
    return replace(gps, fix=np.full(gps.time.shape[0], fix), heading=None)


@dataclass(frozen=True, slots=True)
class NavigatedDrive:
    """Drive navigated with all fixes, and the filter's states at the starts of windows."""

    ready: Prepared
    run: Run
    states: tuple[FilterState, ...]  # in order of time
    clock: float  # time of the run minus sample time [s]


def navigated_drive(
    ready: Prepared, starts: FloatArray, progress: Callable[[float], None] | None = None, *, smooth: bool = True
) -> NavigatedDrive:
    """Navigate the whole drive and store the filter's state at some fixes.

    `starts` (n,): timestamps of these fixes [s]. `smooth`: smooth as well, for smoothed starts and for a simulated
    replica.
    """
    rows = np.searchsorted(ready.gps.time, starts - 1e-6)
    settings = replace(ready.settings, smooth=smooth, output_interval=_SOLUTION)
    navigator = replace(ready, settings=settings).navigator(marks=set(rows.tolist()))
    feed(navigator, ready.imu, progress)
    run = navigator.finish()
    states = tuple(state for _, state in sorted(navigator.kept.items()))
    return NavigatedDrive(ready, run, states, run.gps_delay - ready.settings.delay)


def free_inertial_settings(settings: FilterSettings, *, own_fixes: bool) -> FilterSettings:
    """Return the settings of a filter without fixes and other aiding.

    `own_fixes`: the reference is the drive's fixes, whose velocities may lag.
    """
    return replace(
        settings,
        correlated=None,
        lever_sd=0.0,
        jitter=0.0,
        velocity_lag=settings.velocity_lag if own_fixes else 0.0,
        lag_sd=0.0,
        heading_sd=0.0,
        aiding=None,
        smooth=False,
        output_interval=1e9,
    )


def forward_start(state: FilterState, settings: FilterSettings, lever_b: FloatArray | None) -> FilterState:
    """Return the forward filter's state, after all earlier fixes, as the start of a window.

    `lever_b` (3,): point of the reference seen from the IMU [m]; None for the antenna.
    """
    n = layout(settings).states
    return replace(
        state,
        covariance=state.covariance[:n, :n].copy(),
        correlated=np.zeros(3),
        lever_b=state.lever_b.copy() if lever_b is None else lever_b.copy(),
    )


def uncalibrated_start(start: FilterState, model: ErrorModel) -> FilterState:
    """Remove the filter's estimates of sensor errors from a start: turn-on biases and scale factors in full.

    Estimates and their errors are uncorrelated, as in least mean-square estimation with a true prior. The error without
    correction is then the specified turn-on error. It correlates with position, velocity and attitude as the estimation
    error did.
    """
    covariance = start.covariance.copy()
    sensors = slice(NAV, STATES)
    covariance[sensors, sensors] = np.diag(np.maximum(model.sd**2, np.diag(covariance[sensors, sensors])))
    return replace(start, correction=np.zeros(STATES - NAV), covariance=covariance)


def smoothed_start(start: FilterState, run: Run, clock: float) -> FilterState | None:
    """Replace a start by the smoothed drive; None without a used fix.

    Position, velocity and attitude keep their covariance, sensor errors their variances. Cross-covariances are dropped,
    which makes the prediction slightly too large.

    `clock`: time of the run minus sample time [s].
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


def growth_by_start_error(q_nb: FloatArray, lla: FloatArray) -> FloatArray:
    """Compute the derivatives of error growth by errors at the start of a window.

    For a level vehicle without turns: velocity error, effective horizontal acceleration ``g x phi - C db`` and its
    change ``g x C dw``, for estimate minus truth with ``C_hat = (I - [phi x]) C`` (Groves 2013, section 5.7).

    `q_nb` (4,): initial attitude. `lla` (3,): initial position [rad], [rad], [m].
    Returns: (2, 3, 21): for North and East: velocity [m/s], acceleration [m/s^2], jerk [m/s^3] by the 21 errors of the
    filter.
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


_AT_IMU = np.zeros(3)
_LEAST_SD = 1e-4  # lower limits of the sd [m], [m/s]
_WHOLE = 0.98  # least share of the record that a stationary reference must span


@dataclass(frozen=True, slots=True)
class WindowReference:
    """Reference positions, each with its own standard deviation."""

    fixes: GpsData  # positions, and known velocities, every value with a standard deviation
    name: str  # description, such as "the drive's own GPS fixes"
    # (3,) their point, seen from the IMU, body axes [m]; None for the antenna of the drive
    lever_b: FloatArray | None = None
    own_fixes: bool = False  # the reference is the drive's own fixes


def reference_from_fixes(ready: Prepared) -> WindowReference:
    """Build the reference from the drive's fixes, which the filter does not use in a window."""
    usable = ready.gps.rows(valid(ready.gps) & np.isfinite(ready.gps.lla).all(axis=1))
    return WindowReference(usable, "the drive's own GPS fixes", own_fixes=True)


def reference_from_trajectory(
    reference: Trajectory, name: str, *, position_sd: float, velocity_sd: float, lever_b: FloatArray | None = _AT_IMU
) -> WindowReference:
    """Build the reference from a trajectory.

    `position_sd`, `velocity_sd`: its uncertainty on each axis where it states none [m], [m/s]. `lever_b` (3,): the
    point of the reference seen from the IMU, body axes [m]; None for the antenna.
    Raises: InputError: fewer than two rows.
    """
    if len(reference.time) < 2:
        raise InputError("budget.short_reference", count=len(reference.time))
    shape = reference.lla.shape
    own = np.full((shape[0], 9), np.nan) if reference.sd is None else reference.sd
    sd = np.where(np.isfinite(own[:, :6]), own[:, :6], np.repeat([position_sd, velocity_sd], 3))
    sd = np.maximum(sd, _LEAST_SD)
    velocity_sd_n = np.where(np.isfinite(reference.v_n), sd[:, 3:], np.nan)
    fixes = GpsData(reference.time, reference.lla, reference.v_n, sd[:, :3], velocity_sd_n)
    return WindowReference(fixes, name, lever_b)


def stationary_fixes(lla: FloatArray, begin: float, end: float, position_sd: float, velocity_sd: float) -> GpsData:
    """Build fixes of a stationary vehicle, one per second: a bench without a receiver.

    `lla` (3,): latitude, longitude [rad], height [m]. `begin`, `end`: first and last time [s]. `position_sd`,
    `velocity_sd`: of position and zero velocity, each axis [m], [m/s].
    """
    time: FloatArray = np.arange(begin, end + 1e-6, 1.0)
    shape = (len(time), 3)
    return GpsData(
        time, np.tile(lla, (shape[0], 1)), np.zeros(shape), np.full(shape, position_sd), np.full(shape, velocity_sd)
    )


def is_stationary(reference: Trajectory, begin: float, end: float) -> bool:
    """Return whether a reference of a few rows is stationary over the whole record.

    `begin`, `end`: of the record [s].
    """
    still = bool(np.nan_to_num(reference.v_n).any() == 0) and bool((reference.lla == reference.lla[0]).all())
    return still and float(reference.time[-1] - reference.time[0]) >= _WHOLE * (end - begin)
