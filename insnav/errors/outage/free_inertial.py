"""Free-inertial windows of a drive: navigation from a filter or reference state, without fixes and aiding.

A window has its times, its filter input, an initial state and a reference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from insnav import strapdown
from insnav.attitude import dcm_from_quat, rph_from_quat
from insnav.earth import gravity_n, lla_offset, ned_offset
from insnav.errors.metrics import MOVING_M_S
from insnav.exceptions import ConfigError, InputError
from insnav.filter.error_model import ErrorModel, FilterState, layout
from insnav.filter.filter_input import Aiding, FilterInput, Output
from insnav.filter.navigate import feed
from insnav.filter.navigator import Navigator
from insnav.filter.receiver import Receiver
from insnav.imu import ImuErrors, correct
from insnav.kernels import measurements
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import STATES
from insnav.strapdown import nearest_rows
from insnav.types import BoolArray, FloatArray, GpsData, ImuData, IntArray, Run, SensorErrors, Trajectory

LENGTHS = (5.0, 10.0, 15.0, 30.0, 60.0, 120.0)  # default lengths of GNSS outages [s]
SETTLED = 60.0  # time from the start of navigation to the first window in a long drive [s]
COUNT = 60  # approximate number of windows with the default spacing
CLOSEST = 2.0  # lower limit of the default spacing [s]
StartChoice = Literal["forward", "smoothed"]
_SOLUTION = 0.1  # output interval of the whole drive: for speed, course and the simulated replica [s]
FirstWindow = Literal["quarter of drive", "half of slack"]
_BEFORE = 2.0  # length of the samples before a window, for the polynomials in its first interval [s]
_SAME = 1e-6  # times closer than this are equal [s]
Motion = Literal["static", "straight", "turning"]
MOTIONS: tuple[Motion, ...] = ("static", "straight", "turning")

SHORTEST, LONGEST = 10.0, 300.0  # limits of the window length [s]
LEAST = 0.1  # least spacing [s]
TURNED = np.deg2rad(15.0)  # largest heading change of a straight window [rad]
REFERENCE_GAP = 10.0  # a reference interval longer than this and than three median intervals is a gap [s]
IMU_GAP = 6  # successive lost samples that make a gap of the IMU record
_UNDER_WAY = 1.0  # least speed for a course from the velocity; at lower speed the course is interpolated [m/s]
_SHARED = ("length", "spacing", "grid", "dropped", "uncalibrated")  # fields of `Windows` with one value for all windows


@dataclass(frozen=True, slots=True)
class Outage:
    """Window without fixes, compared with the fixes (or the epochs of a reference) in it."""

    start: float  # time of the last fix before the window [s]
    length: float  # length of the window [s]
    elapsed: FloatArray  # (k,) time since `start` [s]
    # (k, 6) error of position North, East, Down [m] and velocity [m/s] of the filter; ``NaN`` without a value
    error: FloatArray
    sd: FloatArray  # (k, 6) stated standard deviation of the filter
    smoothed: FloatArray  # (k, 6) error of the smoother
    smoothed_sd: FloatArray  # (k, 6) stated standard deviation of the smoother
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

    `fixes` (n,): times of the fixes, on the IMU clock [s]. `begin`, `end`: start and end of navigation [s]. `length`:
    window length, or the shortest of several lengths [s]. `first`: time from `begin` to the first window [s]; default:
    a minute, or less by `rule` on a short drive. `spacing`: interval between starts [s]; by default about sixty windows
    fit. `rule` {"quarter of drive", "half of slack"}: default of `first` on a short drive. With a quarter of the drive,
    windows of several lengths begin at the same fixes. With half of the slack, a single long window still fits.
    Returns: (m,): rows of the fixes, increasing.
    Raises: InputError: the drive is too short.
    """
    drive = end - begin
    several = rule == "quarter of drive"
    if first is None:
        first = min(SETTLED, 0.25 * drive if several else max(0.0, 0.5 * (drive - length)))
    slack = drive - first - length
    if slack < -_SAME:
        raise InputError("outage.drive_too_short", length_s=length, drive_s=drive, first_s=first)
    if spacing is None:
        spacing = max(CLOSEST, (drive - first if several else slack) / COUNT)
    wanted = begin + first + np.arange(int((slack + _SAME) / spacing) + 1) * spacing
    rows = np.unique(np.searchsorted(fixes, wanted - _SAME))
    rows = rows[rows < len(fixes)]
    return np.asarray(rows[fixes[rows] <= end - length + _SAME])


def part_of(ready: FilterInput, state: FilterState, length: float) -> FilterInput:
    """Select the samples that a filter needs to continue from a state for the time `length` [s]."""
    end = min(state.time + length + _BEFORE, ready.unbroken_until(state.time) + _SAME)
    first, last = np.searchsorted(ready.imu.time, [state.time - _BEFORE, end])
    return replace(ready, imu=ready.imu.rows(slice(first, last)), starts=ready.starts[:1])


def comparison_only(gps: GpsData, fix: int = 0) -> GpsData:
    """Mark fixes as invalid or `OF_REFERENCE`: a filter computes their innovations without using them."""
    return replace(gps, fix=np.full(gps.time.shape[0], fix), heading=None)


@dataclass(frozen=True, slots=True)
class NavigatedDrive:
    """Drive navigated with all fixes, and the filter's states at the starts of windows."""

    ready: FilterInput
    run: Run
    states: tuple[FilterState, ...]  # filter states at the starts, in order of time
    clock: float  # time of the run minus sample time [s]


def navigated_drive(
    ready: FilterInput, starts: FloatArray, progress: Callable[[float], None] | None = None, *, smooth: bool = True
) -> NavigatedDrive:
    """Navigate the whole drive and store the filter's state at some fixes.

    `starts` (n,): timestamps of these fixes [s]. `smooth`: smooth as well, for smoothed starts and for a simulated
    replica.
    """
    rows = np.searchsorted(ready.gps.time, starts - 1e-6)
    navigator = Navigator(replace(ready, output=Output(_SOLUTION, smooth)), marks=set(rows.tolist()))
    feed(navigator, ready.imu, progress)
    run = navigator.finish()
    states = tuple(state for _, state in sorted(navigator.kept.items()))
    return NavigatedDrive(ready, run, states, run.gps_delay - ready.receiver.delay.value)


def remove_aiding(ready: FilterInput, *, own_fixes: bool) -> FilterInput:
    """Return filter input for windows without aiding, with fixed lever arm and velocity lag.

    `own_fixes`: the reference is the drive's fixes, whose velocities may lag.
    """
    receiver = ready.receiver
    lever_arm = replace(receiver.lever_arm, sd=0.0)
    lag = replace(receiver.lag, value=receiver.lag.value if own_fixes else 0.0, sd=0.0)
    receiver = replace(receiver, lever_arm=lever_arm, lag=lag, jitter=0.0, correlated=None, heading_sd=0.0)
    return replace(ready, receiver=receiver, aiding=Aiding(), output=Output(1e9, smooth=False))


def forward_start(state: FilterState, receiver: Receiver, lever_b: FloatArray | None) -> FilterState:
    """Return the forward filter's state, after all earlier fixes, as the start of a window.

    `lever_b` (3,): point of the reference seen from the IMU [m]; None for the antenna.
    """
    n = layout(receiver).states
    arm = state.lever_b if lever_b is None else lever_b
    state = state.replace_further(measurements.LASTING, 0.0)
    return replace(state, covariance=state.covariance[:n, :n].copy(), lever_b=arm.copy())


def uncalibrated_start(start: FilterState, model: ErrorModel) -> FilterState:
    """Remove the filter's corrections of biases and scale factors from the start of a window.

    Estimates and their errors are uncorrelated, as in least mean-square estimation with a true prior. The error without
    correction is then the specified turn-on error. It correlates with position, velocity and attitude as the estimation
    error did.
    """
    covariance = start.covariance.copy()
    sensors = slice(NAV, STATES)
    covariance[sensors, sensors] = np.diag(np.maximum(model.sd**2, np.diag(covariance[sensors, sensors])))
    return replace(start, correction=np.zeros(STATES - NAV), covariance=covariance)


def smoothed_start(start: FilterState, run: Run, clock: float) -> FilterState | None:
    """Replace the state at a start by the smoothed state; None without a used fix.

    Position, velocity and attitude keep their covariance, sensor errors their variances. Cross-covariances are dropped,
    which makes the prediction slightly too large.

    `clock`: time of the run minus sample time [s].
    """
    assert run.smoothed is not None
    epochs, sensors = run.smoothed.epochs, run.smoothed.sensor_errors
    row = int(np.searchsorted(epochs.time - clock, start.time - 1e-6))
    if row >= len(epochs.time) or abs(epochs.time[row] - clock - start.time) > 1e-6:
        return None
    covariance = np.zeros_like(start.covariance)
    covariance[:NAV, :NAV] = epochs.covariance[row]
    covariance[NAV:STATES, NAV:STATES] = np.diag(sensors.sd[row] ** 2)
    if covariance.shape[0] > STATES:
        covariance[STATES, STATES] = run.gps_delay_sd**2
    x = np.concatenate([epochs.lla[row], epochs.v_n[row], epochs.q_nb[row]])
    start = start.replace_further(measurements.DELAY, clock)
    return replace(start, x=x, correction=sensors.value[row].copy(), covariance=covariance)


def growth_by_start_error(q_nb: FloatArray, lla: FloatArray) -> FloatArray:
    """Compute how errors at the start of a window determine the growth of its horizontal errors.

    A level vehicle without turns has a velocity error, an effective horizontal acceleration ``g x phi - C db`` and its
    rate of change ``g x C dw``. Attitude error: ``C_hat = (I - [phi x]) C`` (Groves 2013, section 5.7).

    `q_nb` (4,): initial attitude. `lla` (3,): initial position [rad], [rad], [m].
    Returns: (2, 3, 21): for North and East: velocity [m/s], acceleration [m/s^2] and jerk [m/s^3] per unit of each of
    the 21 filter errors.
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
_LEAST_SD = 1e-4  # lower limit of a reference sd [m], [m/s]
_WHOLE = 0.98  # least share of the record that a stationary reference must span


@dataclass(frozen=True, slots=True)
class WindowReference:
    """Reference positions, each with its own standard deviation."""

    fixes: GpsData  # positions, and known velocities, every value with a standard deviation
    name: str  # description, such as "the drive's own GPS fixes"
    # (3,) point of the positions, seen from the IMU, body axes [m]; None for the antenna of the drive
    lever_b: FloatArray | None = None
    own_fixes: bool = False  # True if the reference is the drive's own fixes


def reference_from_fixes(ready: FilterInput) -> WindowReference:
    """Build the reference of windows from the drive's fixes, which the filter does not use in a window."""
    usable = ready.gps.rows(ready.gps.valid & np.isfinite(ready.gps.lla).all(axis=1))
    return WindowReference(usable, "the drive's own GPS fixes", own_fixes=True)


def reference_from_trajectory(
    reference: Trajectory, name: str, *, position_sd: float, velocity_sd: float, lever_b: FloatArray | None = _AT_IMU
) -> WindowReference:
    """Build the reference from a trajectory.

    `position_sd`, `velocity_sd`: sd on each axis where the trajectory states none [m], [m/s]. `lever_b` (3,): the
    point of the reference seen from the IMU, body axes [m]; None for the antenna.
    Raises: InputError: fewer than two rows.
    """
    if len(reference.time) < 2:
        raise InputError("budget.short_reference", count=len(reference.time))
    stated = np.full((reference.lla.shape[0], 9), np.nan) if reference.sd is None else reference.sd
    sd = np.where(np.isfinite(stated[:, :6]), stated[:, :6], np.repeat([position_sd, velocity_sd], 3))
    sd = np.maximum(sd, _LEAST_SD)
    velocity_sd_n = np.where(np.isfinite(reference.v_n), sd[:, 3:], np.nan)
    fixes = GpsData(reference.time, reference.lla, reference.v_n, sd[:, :3], velocity_sd_n)
    return WindowReference(fixes, name, lever_b)


def stationary_fixes(lla: FloatArray, begin: float, end: float, position_sd: float, velocity_sd: float) -> GpsData:
    """Build fixes of a stationary vehicle, one per second, for a bench without a receiver.

    `lla` (3,): latitude, longitude [rad], height [m]. `begin`, `end`: first and last time [s]. `position_sd`,
    `velocity_sd`: standard deviation of position and zero velocity, each axis [m], [m/s].
    """
    time: FloatArray = np.arange(begin, end + 1e-6, 1.0)
    shape = (len(time), 3)
    return GpsData(
        time, np.tile(lla, (shape[0], 1)), np.zeros(shape), np.full(shape, position_sd), np.full(shape, velocity_sd)
    )


def is_stationary(reference: Trajectory, begin: float, end: float) -> bool:
    """Return whether a reference of a few rows is stationary over the whole record.

    `begin`, `end`: start and end of the record [s].
    """
    still = bool(np.nan_to_num(reference.v_n).any() == 0) and bool((reference.lla == reference.lla[0]).all())
    return still and float(reference.time[-1] - reference.time[0]) >= _WHOLE * (end - begin)


@dataclass(frozen=True, slots=True)
class Windows:
    """Set of n windows of one length, compared at k times since their start."""

    length: float  # length of each window [s]
    spacing: float  # requested interval between starts [s]
    start: FloatArray  # (n,) timestamp of the last fix used [s]
    grid: FloatArray  # (k,) nominal times since the start [s]
    elapsed: FloatArray  # (n, k) time from the start to the reference epoch nearest to each grid time [s]
    error: FloatArray  # (n, k, 6) error of position North, East, Down [m], velocity [m/s]; ``NaN`` without reference
    covariance: FloatArray  # (n, k, 6, 6) predicted covariance of position and velocity
    reference_sd: FloatArray  # (n, k, 6) standard deviation of the reference
    course: FloatArray  # (n, k) direction of travel [rad]; ``NaN`` in stationary windows
    q_nb: FloatArray  # (n, k + 1, 4) navigated attitude, starting with the initial one
    v_n: FloatArray  # (n, k + 1, 3) navigated velocity, starting with the initial one [m/s]
    lla: FloatArray  # (n, 3) initial position [rad], [rad], [m]
    start_covariance: FloatArray  # (n, 21, 21) covariance of the filter errors at the start
    motion: np.ndarray  # (n,) ``static``, ``straight`` or ``turning``
    dropped: dict[str, int]  # number of excluded windows by reason
    uncalibrated: bool  # True if the filter's estimates of sensor errors were not corrected

    @property
    def count(self) -> int:
        """Number of windows."""
        return len(self.start)

    def only(self, chosen: BoolArray | np.ndarray) -> Windows:
        """Select windows by mask or index."""
        own = [name for name in self.__slots__ if name not in _SHARED]
        return replace(self, **{name: getattr(self, name)[chosen] for name in own})


def free_window_starts(
    ready: FilterInput, length: float, first: float | None = None, spacing: float | None = None
) -> FloatArray:
    """Find timestamps of fixes at which windows may begin, evenly along the drive.

    `length`: window length [s]. `first`: time from the start of navigation to the first window [s]; by default a
    minute, or less if the drive is short. `spacing`: interval between starts [s]; by default about sixty windows fit.
    Returns: (n,) [s].
    Raises: ConfigError: a length outside 10 to 300 s, a spacing of less than 0.1 s, or a negative `first`. InputError:
    the drive is too short.
    """
    if not SHORTEST <= length <= LONGEST:
        raise ConfigError("budget.window_length", length_s=length, low_s=SHORTEST, high_s=LONGEST)
    if spacing is not None and not LEAST <= spacing < np.inf:
        raise ConfigError("budget.window_spacing", spacing_s=spacing, limit_s=LEAST)
    if first is not None and not 0.0 <= first < np.inf:
        raise ConfigError("budget.window_first", first_s=first)
    stamps = ready.gps.time[ready.gps.valid]
    fixes = stamps - ready.receiver.delay.value
    begin, end = ready.initial.time, float(min(ready.imu.time[-1], fixes[-1]))
    rows = window_starts(fixes, begin, end, length, first=first, spacing=spacing, rule="half of slack")
    return np.asarray(stamps[rows])


def free_windows(
    drive: NavigatedDrive,
    reference: WindowReference,
    length: float,
    spacing: float,
    *,
    uncalibrated: bool = False,
    start: StartChoice = "forward",
    times: FloatArray | None = None,
    progress: Callable[[float], None] | None = None,
) -> Windows:
    """Navigate the windows of a drive without fixes.

    `length`, `spacing`: window length and interval between starts, as in `free_window_starts` [s]. `uncalibrated`:
    do not correct the estimated sensor errors; the prediction then uses specified turn-on errors of the IMU. `start`
    {"forward", "smoothed"}: initial state; a smoothed one depends on the fixes in and after the window. `times` (k,):
    comparison times since the start [s]; by default every second, or every epoch of the reference.
    Returns: windows without gaps; `Windows.dropped` counts the others.
    Raises: InputError: no window remains.
    """
    ready, delay = drive.ready, drive.ready.receiver.delay.value
    free = remove_aiding(ready, own_fixes=reference.own_fixes)
    interval = max(1.0, float(np.median(np.diff(reference.fixes.time))))
    grid: FloatArray = np.arange(1.0, int(length / interval + 1e-6) + 1.0) * interval if times is None else times
    gaps = _gaps(ready, reference)
    course = _course(drive)
    windows: list[dict[str, Any]] = []
    dropped: dict[str, int] = {}
    for number, state in enumerate(drive.states):
        begin = state.time + delay
        end = begin + length
        reason = next((why for a, b, why in gaps if np.any((a < end - 1e-6) & (b > begin + 1e-6))), None)
        compared, known = _compared(reference.fixes, begin + grid, 0.5 * interval)
        if reason is None and not known[-1]:
            reason = "reference_end"
        initial = forward_start(state, free.receiver, reference.lever_b)
        if start == "smoothed" and reason is None:
            smoothed = smoothed_start(initial, drive.run, drive.clock)
            reason = "unused_start" if smoothed is None else None
            initial = initial if smoothed is None else smoothed
        if reason is not None:
            dropped[reason] = dropped.get(reason, 0) + 1
        else:
            initial = uncalibrated_start(initial, ready.model) if uncalibrated else initial
            windows.append(_navigated(part_of(free, initial, length), initial, compared, known, course))
        if progress is not None:
            progress((number + 1) / len(drive.states))
    if not windows:
        values: dict[str, Any] = {"counts": tuple(dropped.values()), "reasons": tuple(dropped)}
        raise InputError("budget.no_window", length_s=length, count=len(drive.states), **values)
    columns = {name: np.stack([each[name] for each in windows]) for name in windows[0]}
    return Windows(length=length, spacing=spacing, grid=grid, dropped=dropped, uncalibrated=uncalibrated, **columns)


def _navigated(
    part: FilterInput,
    first: FilterState,
    compared: GpsData,
    known: BoolArray,
    course: tuple[FloatArray, FloatArray, FloatArray],
) -> dict[str, Any]:
    """Navigate one window from its first state to its last epoch; return its row of each field of `Windows`."""
    delay = part.receiver.delay.value
    run = feed(Navigator(replace(part, gps=compared), first), part.imu).finish()
    innovations, epochs = run.innovations, run.epochs
    reference_sd = np.column_stack([compared.position_sd, compared.velocity_sd])
    covariance = epochs.covariance[:, :6, :6].copy()
    # innovation variance minus reference variance also contains the errors of lever arm and clock
    var = innovations.sd**2 - reference_sd**2
    axis = np.arange(6)
    covariance[:, axis, axis] = np.where(np.isfinite(var) & (var > 0.0), var, covariance[:, axis, axis])
    begin = first.time + delay
    time, speed, direction = course
    inside = (time >= begin) & (time <= compared.time[-1])
    motion = _motion(speed[inside], rph_from_quat(np.vstack([first.x[None, 6:], epochs.q_nb]))[:, 2])
    return {
        "start": begin,
        "elapsed": compared.time - begin,
        "error": np.where(known[:, None], -innovations.innovation, np.nan),
        "covariance": covariance,
        "reference_sd": reference_sd,
        "course": np.where(motion != "static", np.interp(compared.time, time, direction), np.nan),
        "q_nb": np.vstack([first.x[None, 6:], epochs.q_nb]),
        "v_n": np.vstack([first.x[None, 3:6], epochs.v_n]),
        "lla": first.x[:3].copy(),
        "start_covariance": first.covariance[:STATES, :STATES].copy(),
        "motion": motion,
    }


def _motion(speed: FloatArray, heading: FloatArray) -> Motion:
    if speed.size == 0 or float(speed.max()) < MOVING_M_S:
        return "static"
    return "straight" if float(np.ptp(np.unwrap(heading))) <= TURNED else "turning"


def _compared(reference: GpsData, wanted: FloatArray, close: float) -> tuple[GpsData, BoolArray]:
    """Select the reference epochs nearest to the wanted times; also return whether each is within `close` [s]."""
    rows = nearest_rows(reference.time, wanted)
    nearest = reference.time[rows]
    known: BoolArray = np.asarray(np.abs(nearest - wanted) <= close + 1e-6)
    known[1:] &= nearest[1:] > nearest[:-1]
    # the filter outputs its state at every wanted time, also without an epoch of the reference
    return comparison_only(replace(reference.rows(rows), time=np.where(known, nearest, wanted))), known


def _gaps(ready: FilterInput, reference: WindowReference) -> list[tuple[FloatArray, FloatArray, str]]:
    """Find starts and ends of gaps in IMU record and reference, on the clock of the fixes [s]."""
    time, delay = ready.imu.time, ready.receiver.delay.value
    lost = np.flatnonzero(np.diff(time) > (IMU_GAP + 0.5) * ready.nominal)
    stamps = reference.fixes.time
    step = np.diff(stamps)
    gap = np.flatnonzero(step > max(REFERENCE_GAP, 3.0 * float(np.median(step))))
    begin = np.concatenate([[-np.inf], stamps[gap], stamps[-1:]])
    end = np.concatenate([stamps[:1], stamps[gap + 1], [np.inf]])
    return [(time[lost] + delay, time[lost + 1] + delay, "imu_gap"), (begin, end, "reference_gap")]


def _course(drive: NavigatedDrive) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return fix time, speed and direction of travel of the whole drive, interpolated across stops."""
    solution = drive.run.solution
    time = solution.time - drive.clock + drive.ready.receiver.delay.value
    v_north, v_east = solution.v_n[:, 0], solution.v_n[:, 1]
    speed = np.hypot(v_north, v_east)
    moving = speed > _UNDER_WAY
    if not moving.any():
        return time, speed, np.zeros_like(speed)
    direction = np.unwrap(np.arctan2(v_east[moving], v_north[moving]))
    return time, speed, np.interp(time, time[moving], direction)


_LEAD = 1.0  # samples before and after a window, for the polynomials at its ends [s]


def end_errors(
    run: Run,
    imu: ImuData,
    reference: Trajectory,
    length: float,
    most: int,
    *,
    settle: float = 0.0,
    run_clock: float = 0.0,
    reference_clock: float = 0.0,
) -> FloatArray:
    """Compute the horizontal error at the end of windows navigated by the IMU alone.

    Initial position and velocity come from the reference, attitude and sensor errors from the filter.

    `length`: window length [s]. `most`: largest number of windows, evenly along the drive without overlap. `settle`:
    time from the start to the first window [s]. `run_clock`, `reference_clock`: times of the run and of the reference
    minus sample times [s].
    Returns: (n,) [m]; empty if the drive is too short.
    """
    filtered = run.solution
    begin = max(filtered.time[0] - run_clock, reference.time[0] - reference_clock, imu.time[0]) + settle
    last = min(filtered.time[-1] - run_clock, reference.time[-1] - reference_clock, imu.time[-1] - _LEAD) - length
    error = []
    for wanted in np.arange(begin, last, max(length, (last - begin) / most)):
        row = int(np.searchsorted(filtered.time - run_clock, wanted))
        start = float(filtered.time[row]) - run_clock
        if start > last:
            break
        end = start + length
        lla, v_n = _state(reference, start + reference_clock)
        samples = imu.rows(slice(*np.searchsorted(imu.time, [start - _LEAD, end + _LEAD])))
        parts = strapdown.intervals(correct(samples, _estimated(run.sensor_errors, start + run_clock)))
        inc = strapdown.increments(parts, strapdown.split(parts, np.array([start, end]), 0, len(parts.end)))
        tolerance = strapdown.TIME_TOLERANCE
        inc = inc.rows((inc.time > start + tolerance) & (inc.time < end + tolerance))
        navigated = strapdown.navigate(inc, lla, v_n, filtered.rph[row])
        end_lla, _ = _state(reference, end + reference_clock)
        error.append(float(np.hypot(*ned_offset(navigated.lla[-1], end_lla)[:2])))
    return np.array(error)


def _state(trajectory: Trajectory, time: float) -> tuple[FloatArray, FloatArray]:
    """Interpolate velocity between two rows, and extrapolate position from the nearest row by the mean velocity."""
    row = int(strapdown.nearest_rows(trajectory.time, time))
    after = min(row + 1, len(trajectory.time) - 1)
    first = after - 1
    share = (time - trajectory.time[first]) / (trajectory.time[after] - trajectory.time[first])
    v_n = trajectory.v_n[first] + share * (trajectory.v_n[after] - trajectory.v_n[first])
    return lla_offset(trajectory.lla[row], 0.5 * (trajectory.v_n[row] + v_n) * (time - trajectory.time[row])), v_n


def _estimated(errors: SensorErrors, time: float) -> ImuErrors:
    """Return the latest estimate of the sensor errors at a time."""
    value = errors.value[max(int(np.searchsorted(errors.time, time, side="right")) - 1, 0)]
    return ImuErrors(
        gyro_bias=value[0:3],
        gyro_matrix=np.diag(1.0 + value[6:9]),
        accel_bias=value[3:6],
        accel_matrix=np.diag(1.0 + value[9:12]),
    )
