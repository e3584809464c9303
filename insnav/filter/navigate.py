"""From the samples and fixes of one recording to a run: align, set up the filter, feed it in blocks."""

from __future__ import annotations

from collections.abc import Callable, Container
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from insnav import strapdown
from insnav.alignment import align, rest_of
from insnav.alignment import in_motion as motion
from insnav.alignment.align import LEVEL_SPAN
from insnav.attitude import dcm_from_rph
from insnav.earth import lla_offset
from insnav.exceptions import AlignmentError, InputError
from insnav.filter.aiding import Aiding, HeightAid
from insnav.filter.error_model import ErrorModel, InitialState, error_model, initial_state
from insnav.filter.gates import Gates
from insnav.filter.gps_correlation import correlated_noise
from insnav.filter.gps_noise import LAG_WORTH, velocity_lag, with_sd
from insnav.filter.navigator import Navigator
from insnav.filter.settings import FilterSettings
from insnav.filter.vehicle_calibration import learn
from insnav.imu.health import inspect
from insnav.imu.specification import ImuSpec
from insnav.types import Alignment, Event, EventKind, FloatArray, GpsData, ImuData, Run

AidingChoice = Literal["auto", "on", "off"]
BLOCK = 1 << 16  # samples a call of the filter takes
STILL_SD = 0.05  # velocity of a vehicle found at rest [m/s]
LONGEST_HOLE = 3.0  # longest hole in the IMU record that is bridged [s]
JITTER_WORTH = 1e-4  # smaller scatter of the time stamps is rounding [s]
HOLE_WORTH = 3.0  # GPS holes longer than this are worth a second pass with whatever else helps [s]
LEARNING_INTERVAL = 0.1  # of the solution from which the vehicle is learned [s]
DELAY_SD = 0.05  # how well receivers and loggers agree on time if nothing else is known [s]


@dataclass(frozen=True, slots=True)
class Start:
    """Initial state that the user gives.

    Attributes
    ----------
    time : float
        [s]
    lla, v_n, rph : (3,) array
        Latitude, longitude [rad], height [m]; velocity N, E, D [m/s]; roll, pitch, heading [rad].
    position_sd, velocity_sd, attitude_sd : (3,) array
        Standard deviations [m], [m/s], [rad].
    """

    time: float
    lla: FloatArray
    v_n: FloatArray
    rph: FloatArray
    position_sd: FloatArray
    velocity_sd: FloatArray
    attitude_sd: FloatArray


@dataclass(frozen=True, slots=True)
class Navigated:
    """A run and what was assumed on the way to it.

    Attributes
    ----------
    run : Run
        The result.
    gps : GpsData
        The fixes as they were used, every value with a standard deviation.
    notes : tuple of str
        Assumptions in words.
    """

    run: Run
    gps: GpsData
    notes: tuple[str, ...] = field(default=())


@dataclass(frozen=True, slots=True)
class Prepared:
    """A recording ready for the filter.

    Attributes
    ----------
    imu : ImuData
        Samples, calibrated.
    gps : GpsData
        Fixes, every value with a standard deviation.
    model : ErrorModel
        Noise of the sensors.
    settings : FilterSettings
        With what the data tell about lag, jitter and lasting errors.
    alignment : Alignment
        Attitude to start from.
    initial : InitialState
        State to start from.
    nominal : float
        Sampling interval [s].
    notes : tuple of str
        Assumptions in words.
    faults : tuple of Event
        Samples that were replaced or taken out.
    """

    imu: ImuData
    gps: GpsData
    model: ErrorModel
    settings: FilterSettings
    alignment: Alignment
    initial: InitialState
    nominal: float
    notes: tuple[str, ...]
    faults: tuple[Event, ...] = ()

    def navigator(self, marks: Container[int] = ()) -> Navigator:
        """Filter at the start; see `Navigator` for `marks`."""
        return Navigator(self.initial, self.model, self.gps, self.alignment, self.nominal, self.settings, marks)


def navigate_recording(
    imu: ImuData,
    gps: GpsData,
    spec: ImuSpec,
    settings: FilterSettings,
    *,
    states: int = 21,
    start: Start | None = None,
    static_span: tuple[float, float] | None = None,
    heading: float | None = None,
    aiding: AidingChoice = "auto",
    progress: Callable[[float], None] | None = None,
) -> Navigated:
    """Navigate one recording: `prepare` it and feed it to the filter.

    Parameters
    ----------
    imu : ImuData
        Samples, calibrated.
    gps : GpsData
        Fixes.
    spec : ImuSpec
        How good the sensors are.
    settings : FilterSettings
        Lever arm, delay, gates, output.
    states : {21, 15}
        With or without scale factor errors.
    start : Start, optional
        Initial state; by default the data are aligned.
    static_span : tuple of float, optional
        Static interval for the alignment [s].
    heading : float, optional
        Heading at the start [rad].
    aiding : {"auto", "on", "off"}
        Use what the data tell about wheels, wheel speed and rest, found in a first pass: where GPS leaves holes, always
        or never.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    Navigated
        Run and notes.

    Raises
    ------
    InputError
        No fixes, a hole of more than three seconds, an initial state outside the record.
    AlignmentError
        The data do not determine the attitude.
    DivergenceError
        The filter lost consistency.
    """
    ready = prepare(imu, gps, spec, settings, states=states, start=start, static_span=static_span, heading=heading)
    if aiding == "on" or (aiding == "auto" and longest_hole(ready.gps) > HOLE_WORTH):
        ready = aided(ready, spec, None if progress is None else _part_of(progress, 0.0))
        progress = None if progress is None else _part_of(progress, 0.5)
    navigator = ready.navigator()
    feed(navigator, ready.imu, progress)
    run = navigator.finish()
    on_time = ready.gps.time - settings.delay
    events = (*ready.faults, *run.events, *_outside(on_time, ready.initial.time, float(imu.time[-1])))
    return Navigated(replace(run, events=events), ready.gps, ready.notes)


def _part_of(progress: Callable[[float], None], before: float) -> Callable[[float], None]:
    return lambda done: progress(before + 0.5 * done)


def longest_hole(gps: GpsData) -> float:
    """Longest time without a fix that says it is one [s]."""
    time = gps.time if gps.fix is None else gps.time[gps.fix != 0]
    return float(np.max(np.diff(time))) if time.shape[0] > 1 else 0.0


def aided(ready: Prepared, spec: ImuSpec, progress: Callable[[float], None] | None = None) -> Prepared:
    """Navigate once to learn about the vehicle, and add what helps to the settings.

    Parameters
    ----------
    ready : Prepared
        The recording.
    spec : ImuSpec
        How good the sensors are.
    progress : callable, optional
        Called with the fraction done.
    """
    given = ready.settings.aiding
    settings = replace(ready.settings, smooth=True, output_interval=LEARNING_INTERVAL)
    navigator = replace(ready, settings=settings).navigator()
    feed(navigator, ready.imu, progress)
    run = navigator.finish()
    assert run.smoothed is not None
    clock = run.gps_delay - ready.settings.delay
    solution = replace(run.smoothed.solution, time=run.smoothed.solution.time - clock)
    found = learn(solution, ready.imu, replace(ready.gps, time=ready.gps.time - run.gps_delay), spec)
    aiding = found.aiding if given is None else replace(found.aiding, height=given.height or found.aiding.height)
    return replace(ready, settings=replace(ready.settings, aiding=aiding), notes=(*ready.notes, *found.notes))


def feed(navigator: Navigator, imu: ImuData, progress: Callable[[float], None] | None = None) -> None:
    """Give a filter the samples of a recording in blocks.

    Parameters
    ----------
    navigator : Navigator
        The filter.
    imu : ImuData
        All samples.
    progress : callable, optional
        Called with the fraction done.
    """
    n = imu.time.shape[0]
    for k in range(0, n, BLOCK):
        navigator.feed(imu.rows(slice(k, k + BLOCK)))
        if progress is not None:
            progress(min(1.0, (k + BLOCK) / n))


def prepare(
    imu: ImuData,
    gps: GpsData,
    spec: ImuSpec,
    settings: FilterSettings,
    *,
    states: int = 21,
    start: Start | None = None,
    static_span: tuple[float, float] | None = None,
    heading: float | None = None,
) -> Prepared:
    """Find out from a recording what the filter must know, and align; see `navigate_recording`."""
    imu, faults = inspect(imu)
    _check(imu, gps, start)
    claimed = bool(np.isfinite(gps.position_sd).all())
    gps, notes = with_sd(gps)
    lag, lag_sd = velocity_lag(gps)
    if abs(lag) > max(LAG_WORTH, 5.0 * lag_sd):
        settings = replace(settings, velocity_lag=lag)
        notes += (f"GPS velocity is {lag:.3f} s older than position, by the fixes themselves: taken into account",)
    lasting = correlated_noise(gps, settings.velocity_lag, claimed=claimed)
    if lasting is not None:
        settings = replace(settings, correlated=lasting)
        seen = "since from fix to fix they scatter less than the fixes claim" if lasting.by_claim else "as seen in them"
        notes += (
            f"GPS position errors last: {100 * lasting.share:.0f} % of their variance has a correlation time of about "
            f"{lasting.time:.0f} s, {seen} beside the velocities; estimated as states",
        )
    step = np.diff(imu.time[: 1 << 16])
    jitter = float(np.std(step[step < strapdown.GAP * np.median(step)]))
    if jitter > JITTER_WORTH:
        settings = replace(settings, jitter=jitter)
        notes += (f"IMU time stamps scatter by {1e3 * jitter:.2f} ms: added to the noise of the fixes",)
    model = error_model(spec, states)
    nominal = strapdown.nominal_interval(imu.time)
    on_time = replace(gps, time=gps.time - settings.delay)
    if start is None:
        good = _good(on_time, settings.gates)
        parts = strapdown.intervals(_first_part(imu, good), nominal)
        alignment = align(parts, spec, good, static_span=static_span, heading=heading)
        initial = _at_fix(alignment, good, model, settings)
    else:
        alignment = _given(start)
        initial = initial_state(alignment, model, start.lla, start.v_n, start.position_sd, start.velocity_sd)
    if settings.fixed_height_sd > 0.0:
        level = HeightAid(np.array([initial.time]), initial.lla[2:], settings.fixed_height_sd)
        settings = replace(settings, aiding=Aiding(height=level))
    return Prepared(imu, gps, model, settings, alignment, initial, nominal, notes, tuple(faults))


def _check(imu: ImuData, gps: GpsData, start: Start | None) -> None:
    """Refuse what cannot be navigated."""
    nominal = strapdown.nominal_interval(imu.time)
    if gps.time.shape[0] == 0:
        raise InputError("there is no GPS fix", fix="give a file with fixes")
    step = np.diff(imu.time)
    longest = int(np.argmax(step))
    if step[longest] > LONGEST_HOLE:
        raise InputError(
            f"the IMU record has a hole of {step[longest]:.1f} s",
            where=f"after time {imu.time[longest]:.3f} s",
            why=f"nothing tells how the vehicle turned; up to {LONGEST_HOLE:g} s are bridged",
            fix="cut the file there and navigate the parts one by one",
        )
    if start is not None and not imu.time[0] - nominal - strapdown.TIME_TOLERANCE <= start.time < imu.time[-1]:
        raise InputError(
            "the initial state lies outside the IMU record",
            why=f"it is for {start.time:.3f} s, the samples run from {imu.time[0]:.3f} to {imu.time[-1]:.3f} s",
            fix="give a state inside the record with --initial, or leave it out: insnav then aligns by itself",
        )


def _good(gps: GpsData, gates: Gates) -> GpsData:
    """Fixes that the quality gate lets through; a start is made from no others."""
    keep = gps.position_sd.max(axis=1) <= gates.max_sd
    if gps.fix is not None:
        keep &= gps.fix != 0
    if not keep.any():
        raise AlignmentError("no GPS fix is good enough to start from", fix="check fix types and standard deviations")
    return gps.rows(keep)


def first_rest(imu: ImuData, gps: GpsData) -> tuple[float, float] | None:
    """First rest of a recording, by IMU and GPS.

    Parameters
    ----------
    imu : ImuData
        Samples.
    gps : GpsData
        Fixes.

    Returns
    -------
    tuple of float or None
        Start and end [s].
    """
    gps = _good(with_sd(gps)[0], Gates())
    return rest_of(strapdown.intervals(_first_part(imu, gps), strapdown.nominal_interval(imu.time)), gps)


def _first_part(imu: ImuData, gps: GpsData) -> ImuData:
    """Samples up to a little after the first motion that GPS sees: no alignment looks farther."""
    moving = motion.first_motion(motion.velocity(gps), float(imu.time[0]))
    if moving is None:
        return imu
    return imu.rows(slice(int(np.searchsorted(imu.time, moving + 2.0 * motion.SPAN + LEVEL_SPAN))))


def _at_fix(alignment: Alignment, gps: GpsData, model: ErrorModel, settings: FilterSettings) -> InitialState:
    """Initial state at the fix the alignment was made for."""
    row = int(np.argmin(np.abs(gps.time - alignment.time)))
    alignment = replace(alignment, time=float(gps.time[row]))
    arm = dcm_from_rph(alignment.rph) @ settings.lever_b
    lla = lla_offset(gps.lla[row], -arm)
    horizontal = float(np.hypot(settings.lever_b[0], settings.lever_b[1]))
    position_sd = np.hypot(gps.position_sd[row], horizontal * min(float(alignment.sd[2]), 1.0))
    if alignment.static is not None:
        return initial_state(alignment, model, lla, np.zeros(3), position_sd, np.full(3, STILL_SD), from_fix=True)
    if np.isfinite(gps.v_n[row]).all():
        return initial_state(
            alignment, model, lla, gps.v_n[row], position_sd, np.hypot(gps.velocity_sd[row], 0.1), from_fix=True
        )
    speed = motion.velocity(gps)
    near = np.argsort(np.abs(speed.time - alignment.time))[:3]
    v_n = speed.v_n[near].mean(axis=0)
    away = float(np.abs(speed.time[near].mean() - alignment.time))
    sd = np.hypot(np.median(speed.sd[near]), 2.0 * away)  # vehicles seldom accelerate faster than 2 m/s^2
    return initial_state(alignment, model, lla, v_n, position_sd, np.full(3, sd), from_fix=True)


def _given(start: Start) -> Alignment:
    return Alignment(start.time, start.rph, start.attitude_sd, np.zeros(3), np.full(3, np.inf), None, "given", "given")


def _outside(fixes: FloatArray, start: float, end: float) -> list[Event]:
    """One event for the fixes before the start of navigation and one for those after the last sample."""
    found = []
    for which, count, time in (
        ("before the start", int((fixes < start - 1e-6).sum()), start),
        ("after the last IMU sample", int((fixes > end + 1e-6).sum()), end),
    ):
        if count:
            found.append(Event(time, EventKind.GPS_OUTSIDE, float(count), float("nan"), "fixes", f"not used: {which}"))
    return found
