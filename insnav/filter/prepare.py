"""From the samples and fixes of a recording to a filter at its start: check, look at the noise of the fixes, align."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from insnav import strapdown
from insnav.alignment import align, stationary_of
from insnav.alignment import in_motion as motion
from insnav.alignment.align import LEVEL_SPAN
from insnav.attitude import dcm_from_rph
from insnav.earth import lla_offset
from insnav.exceptions import AlignmentError, InputError
from insnav.filter.error_model import ErrorModel, InitialState, error_model, initial_state
from insnav.filter.gates import Gates
from insnav.filter.gps_correlation import correlated_noise
from insnav.filter.gps_noise import LAG_WORTH, velocity_lag, with_sd
from insnav.filter.measurements.height import HeightAiding
from insnav.filter.navigator import Navigator
from insnav.filter.settings import FilterSettings
from insnav.imu.health import inspect
from insnav.imu.specification import ImuSpec
from insnav.types import Alignment, Event, FloatArray, GpsData, ImuData

if TYPE_CHECKING:
    from insnav.filter.noise_identification import NoiseEstimate

STILL_SD = 0.05  # velocity of a vehicle that the alignment found stationary, its engine running [m/s]
LONGEST_GAP = 3.0  # longest data gap that is bridged: the turn within a longer one is anybody's guess [s]
JITTER_WORTH = 1e-4  # a smaller scatter of the timestamps is rounding; at 30 m/s it makes 3 mm [s]
DELAY_SD = 0.05  # how well receivers and loggers agree on time if nothing else is known [s]
ACCELERATION = 2.0  # vehicles seldom accelerate faster [m/s^2]
CORRELATED = "time-correlated GPS position errors"
START_VELOCITY_SD = 0.1  # lever arm and turn between antenna and IMU at the start, on top of the fix [m/s]


@dataclass(frozen=True, slots=True)
class Start:
    """Initial state that the user gives."""

    time: float  # [s]
    # (3,) latitude, longitude [rad], height [m]; velocity N, E, D [m/s]; roll, pitch, heading [rad]
    lla: FloatArray
    v_n: FloatArray
    rph: FloatArray
    # (3,) standard deviations [m], [m/s], [rad]
    position_sd: FloatArray
    velocity_sd: FloatArray
    attitude_sd: FloatArray


@dataclass(frozen=True, slots=True)
class Prepared:
    """A recording ready for the filter."""

    imu: ImuData  # samples, calibrated
    gps: GpsData  # fixes, every value with a standard deviation
    model: ErrorModel  # noise of the sensors
    settings: FilterSettings  # with lag, jitter and time-correlated errors as found in the data
    alignment: Alignment  # initial attitude
    initial: InitialState  # initial state
    nominal: float  # sampling interval [s]
    notes: tuple[str, ...]  # what was found, and what was done about it
    faults: tuple[Event, ...] = ()  # samples that were replaced or taken out
    noise: NoiseEstimate | None = None  # as found in the innovations of the drive
    clock: float = 0.0  # by which the samples were moved into the time of the fixes [s]: their delay as it was found

    def navigator(self, marks: Container[int] = ()) -> Navigator:
        """Filter at the start; see `Navigator` for `marks`."""
        return Navigator(self.initial, self.model, self.gps, self.alignment, self.nominal, self.settings, marks)


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
    reported = bool(np.isfinite(gps.position_sd).all())
    gps, notes = with_sd(gps)
    settings, found = _noise_of_fixes(imu, gps, settings, reported=reported)
    model = error_model(spec, states)
    nominal = strapdown.nominal_interval(imu.time)
    if start is None:
        good = _good(replace(gps, time=gps.time - settings.delay), settings.gates)
        parts = strapdown.intervals(_first_part(imu, good), nominal)
        alignment = align(parts, spec, good, static_span=static_span, heading=heading, yaw=settings.mounting_yaw)
        initial = _at_fix(alignment, good, model, settings)
    else:
        alignment = Alignment(
            start.time, start.rph, start.attitude_sd, np.zeros(3), np.full(3, np.inf), None, "given", "given"
        )
        initial = initial_state(alignment, model, start.lla, start.v_n, start.position_sd, start.velocity_sd)
    if settings.fixed_height_sd > 0.0:
        level = HeightAiding(np.array([initial.time]), initial.lla[2:], np.array([settings.fixed_height_sd]))
        settings = replace(settings, aiding=(level,))
    return Prepared(imu, gps, model, settings, alignment, initial, nominal, (*notes, *found), tuple(faults))


def first_stationary(imu: ImuData, gps: GpsData) -> tuple[float, float] | None:
    """First stationary interval of a recording, by IMU and GPS: start and end [s], or None."""
    gps = _good(with_sd(gps)[0], Gates())
    return stationary_of(strapdown.intervals(_first_part(imu, gps), strapdown.nominal_interval(imu.time)), gps)


def _check(imu: ImuData, gps: GpsData, start: Start | None) -> None:
    """Refuse what cannot be navigated."""
    nominal = strapdown.nominal_interval(imu.time)
    if gps.time.shape[0] == 0:
        raise InputError("there is no GPS fix", fix="give a file with fixes")
    step = np.diff(imu.time)
    longest = int(np.argmax(step))
    if step[longest] > LONGEST_GAP:
        raise InputError(
            f"the IMU record has a data gap of {step[longest]:.1f} s",
            where=f"after time {imu.time[longest]:.3f} s",
            why=f"the attitude is lost in it; up to {LONGEST_GAP:g} s are bridged",
            fix="cut the file there and navigate the parts one by one",
        )
    if start is not None and not imu.time[0] - nominal - strapdown.TIME_TOLERANCE <= start.time < imu.time[-1]:
        raise InputError(
            "the initial state lies outside the IMU record",
            why=f"it is for {start.time:.3f} s, the samples run from {imu.time[0]:.3f} to {imu.time[-1]:.3f} s",
            fix="give a state inside the record with --initial, or leave it out: insnav then aligns by itself",
        )


def _noise_of_fixes(
    imu: ImuData, gps: GpsData, settings: FilterSettings, *, reported: bool
) -> tuple[FilterSettings, list[str]]:
    """Settings with velocity lag, time-correlated errors and timestamp jitter, and notes on them."""
    notes = []
    lag, lag_sd = velocity_lag(gps)
    if abs(lag) > max(LAG_WORTH, 5.0 * lag_sd):
        settings = replace(settings, velocity_lag=lag)
        notes.append(f"GPS velocity lags position by {lag:.3f} s; corrected")
    correlated = correlated_noise(gps, settings.velocity_lag, reported=reported)
    if correlated is not None:
        settings = replace(settings, correlated=correlated)
        by = "that successive fixes lack of the reported one" if correlated.by_reported else "seen against velocity"
        notes.append(
            f"{CORRELATED}: {100 * correlated.share:.0f} % of the variance ({by}), correlation "
            f"time about {correlated.time:.0f} s; estimated as states"
        )
    step = np.diff(imu.time[: 1 << 16])
    jitter = float(np.std(step[step < strapdown.GAP * np.median(step)]))
    if jitter > JITTER_WORTH:
        settings = replace(settings, jitter=jitter)
        notes.append(f"IMU timestamp jitter {1e3 * jitter:.2f} ms; measurement noise increased")
    return settings, notes


def _good(gps: GpsData, gates: Gates) -> GpsData:
    """Fixes that pass the quality gate; a start is made from no others."""
    keep = gps.position_sd.max(axis=1) <= gates.max_sd
    if gps.fix is not None:
        keep &= gps.fix != 0
    if not keep.any():
        raise AlignmentError("no GPS fix is good enough to start from", fix="check fix types and standard deviations")
    return gps.rows(keep)


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
    # an uncertain heading swings the horizontal part of the lever arm, by its length at most
    horizontal = float(np.hypot(settings.lever_b[0], settings.lever_b[1]))
    position_sd = np.hypot(gps.position_sd[row], horizontal * min(float(alignment.sd[2]), 1.0))
    if alignment.static is not None:
        v_n, velocity_sd = np.zeros(3), np.full(3, STILL_SD)
    elif np.isfinite(gps.v_n[row]).all():
        v_n, velocity_sd = gps.v_n[row], np.hypot(gps.velocity_sd[row], START_VELOCITY_SD)
    else:
        speed = motion.velocity(gps)
        near = np.argsort(np.abs(speed.time - alignment.time))[:3]
        v_n = speed.v_n[near].mean(axis=0)
        away = float(np.abs(speed.time[near].mean() - alignment.time))
        velocity_sd = np.full(3, np.hypot(np.median(speed.sd[near]), ACCELERATION * away))
    return initial_state(alignment, model, lla, v_n, position_sd, velocity_sd, from_fix=True)
