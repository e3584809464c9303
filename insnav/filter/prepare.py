"""Preparation of samples and fixes for the filter: check, estimate the noise of the fixes, align."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from insnav import spill, strapdown
from insnav.alignment import align, stationary_of
from insnav.alignment import in_motion as motion
from insnav.alignment.align import LEVEL_SPAN, count_false_start, without_false_motion
from insnav.alignment.static import LONG_REST
from insnav.exceptions import AlignmentError, InputError
from insnav.filter.error_model import ErrorModel, InitialState, Part, error_model, initial_state
from insnav.filter.filter_input import LONGEST_REST, FilterInput
from insnav.filter.gates import Gates, pass_quality, without_frozen
from insnav.filter.gps_noise import LAG_WORTH, correlated_noise, name_lag, velocity_lag, with_sd
from insnav.filter.receiver import Lag, Receiver
from insnav.findings import Code, Finding
from insnav.imu.health import inspect
from insnav.imu.noise_density import rounding_changes
from insnav.imu.specification import ImuSpec
from insnav.types import Alignment, FloatArray, GpsData, ImuData

STILL_SD = 0.05  # sd of the velocity of a stationary vehicle with its engine running [m/s]
JITTER_WORTH = 1e-4  # smaller scatter of sample timestamps is ignored as rounding; at 30 m/s, it is 3 mm [s]
LONGEST_GAP = 3.0  # longest data gap that the filter bridges: the turn in a longer gap is unknown [s]
SHORTEST = 10.0  # shortest part that is navigated: shorter ones do not suffice for an alignment [s]
FEWEST_FIXES = 5  # least number of fixes to align a part of the record separately
ROUNDS = 3  # repetitions of the alignment, each with the lever arm in the attitude of the previous one
AFTER = 2.0 * motion.SPAN + LEVEL_SPAN  # alignment uses data up to this time after the first motion or the start [s]
START_VELOCITY_SD = 0.1  # velocity of the antenna relative to the IMU at the start, added to the sd of the fix [m/s]


@dataclass(frozen=True, slots=True)
class Start:
    """Initial state specified by the user."""

    time: float  # time of the initial state [s]
    # (3,) latitude, longitude [rad], height [m]. Velocity N, E, D [m/s]. Roll, pitch, heading [rad]
    lla: FloatArray
    v_n: FloatArray
    rph: FloatArray
    # (3,) standard deviations of position [m], velocity [m/s], attitude [rad]
    position_sd: FloatArray
    velocity_sd: FloatArray
    attitude_sd: FloatArray


@dataclass(frozen=True, slots=True)
class GivenStart:
    """Inputs to the alignment that the user specified. The data determine the missing ones."""

    state: Start | None = None
    static_span: tuple[float, float] | None = None  # begin and end of a stationary interval [s]
    heading: float | None = None  # heading at the start [rad]
    mounting_yaw: float = 0.0  # of the IMU, positive to the right [rad]; see `insnav.alignment.mounting`


def prepare(
    imu: ImuData,
    gps: GpsData,
    spec: ImuSpec,
    receiver: Receiver,
    *,
    states: int = 21,
    known: GivenStart = GivenStart(),  # frozen
    nominal: float | None = None,
    as_given: bool = False,
) -> tuple[FilterInput, tuple[Finding, ...]]:
    """Prepare a recording for the filter: check it, estimate the noise of the fixes, align it. Return also findings.

    `spec`: of the IMU. `receiver`: specified or assumed. `states`: 21 or 15, with or without scale factor errors.
    `known`: specified inputs to the alignment. `nominal`: sampling interval, by default from the samples [s].
    `as_given`: do not estimate the noise of the fixes.
    Raises: InputError: no fixes, or an initial state outside the record. AlignmentError: attitude not observable.
    """
    start, static_span = known.state, known.static_span
    imu, faults = inspect(imu)
    _check(imu, gps, start)
    reported = bool(np.isfinite(gps.position_sd).all())
    gps, notes = with_sd(gps)
    gps, frozen = without_frozen(gps, imu)
    receiver, findings = (receiver, []) if as_given else _noise_of_fixes(imu, gps, receiver, reported=reported)
    model = error_model(spec, states)
    nominal = nominal or strapdown.nominal_interval(imu.time)
    usable = good_fixes(replace(gps, time=gps.time - receiver.delay.value)) if start is None else gps
    if start is None and (false := count_false_start(usable)):
        left_out = Finding.of(Code.ALIGN_FALSE_START, usable.time[0], usable.time[false], subject="gps", count=false)
        usable, notes = usable.rows(slice(false, None)), (*notes, left_out)

    def aligned(samples: ImuData, part_gps: GpsData, *, first: bool) -> tuple[Alignment, InitialState]:
        """Align a part of the record, and return also its initial state. `first`: no earlier part was aligned."""
        if start is not None and first:
            return _as_given(start, model)
        inside = static_span is not None and samples.time[0] - nominal <= static_span[0] < samples.time[-1]
        antenna_fixes = fixes = _resting(samples, part_gps)
        intervals = strapdown.intervals(_first_part(samples, antenna_fixes), nominal)
        for remaining in reversed(range(ROUNDS if receiver.lever_arm.value.any() else 1)):
            alignment = align(
                intervals,
                spec,
                fixes,
                static_span=static_span if first or inside else None,
                heading=known.heading if first else None,
                yaw=known.mounting_yaw,
                lever_sd=receiver.lever_arm.sd,
            )
            if remaining:  # in a turn, the course of the antenna differs from the course of the IMU
                fixes = motion.at_imu(antenna_fixes, intervals, alignment, receiver.lever_arm.value)
        return alignment, _at_fix(alignment, intervals, part_gps, model, receiver)

    imu, parts, of_parts = _parts(imu, usable, aligned, -np.inf if start is None else start.time)
    alignment, initial = parts[0].alignment, parts[0].initial
    notes = (*notes, *of_parts[:1])
    if alignment.heading_method is Code.ALIGN_HEADING_CREEPING:
        notes = (*notes, Finding.of(Code.ALIGN_HEADING_CREEPING, sd_rad=alignment.sd[2]))
    begin = float(max(imu.time[0], usable.time[0]))
    if start is None and initial.time - begin > LONG_REST:
        notes = (*notes, Finding.of(Code.ALIGN_LATE, begin, initial.time, duration_s=initial.time - begin))
    rounding = () if as_given else rounding_changes(imu)
    ready = FilterInput(imu, gps, model, parts, nominal, receiver, rounding=rounding)
    return ready, (*notes, *findings, *faults, *frozen, *of_parts[1:])


def align_again(ready: FilterInput, alignment: Alignment) -> FilterInput:
    """Copy with another alignment, and the initial state at the fix nearest to its time."""
    good = _without_false_start(good_fixes(replace(ready.gps, time=ready.fix_time), ready.gates))
    until = int(np.searchsorted(ready.imu.time, alignment.time + AFTER))
    parts = strapdown.intervals(ready.imu.rows(slice(until)), ready.nominal)
    return ready.replace_start(alignment, _at_fix(alignment, parts, good, ready.model, ready.receiver))


def _as_given(start: Start, model: ErrorModel) -> tuple[Alignment, InitialState]:
    none, unknown = np.zeros(3), np.full(3, np.inf)
    methods = Code.ALIGN_LEVEL_GIVEN, Code.ALIGN_HEADING_GIVEN
    alignment = Alignment(start.time, start.rph, start.attitude_sd, none, unknown, None, *methods)
    return alignment, initial_state(alignment, model, start.lla, start.v_n, start.position_sd, start.velocity_sd)


def _parts(
    imu: ImuData, gps: GpsData, aligned: Callable[..., tuple[Alignment, InitialState]], begin_at: float
) -> tuple[ImuData, tuple[Part, ...], list[Finding]]:
    """Align the record, and again after each long gap of the samples.

    `aligned`: function that aligns samples and fixes of a part. `begin_at`: parts that end earlier are skipped [s].
    Returns: samples of the aligned parts, these parts, and findings. Raises: AlignmentError: no part can be aligned.
    """
    nominal, rows = strapdown.nominal_interval(imu.time), spans(imu)
    if len(rows) == 1:
        return imu, (Part(float(imu.time[0]), *aligned(imu, gps, first=True)),), []
    kept = np.zeros(imu.time.shape[0], dtype=np.bool_)
    parts: list[Part] = []
    longest = float(np.max(np.diff(imu.time)))
    findings = [Finding.of(Code.FILTER_PARTS, gap_s=longest, limit_s=LONGEST_GAP, count=len(rows) - 1)]
    errors: list[AlignmentError] = []
    for number, span in enumerate(rows, start=1):
        samples = imu.rows(span)
        begin, end = float(samples.time[0]), float(samples.time[-1])
        fixes = gps.rows((gps.time >= begin - nominal) & (gps.time <= end))
        after = float(imu.time[kept][-1]) if parts else begin
        short = end - begin < SHORTEST or fixes.time.shape[0] < FEWEST_FIXES
        try:
            if end <= begin_at:
                raise AlignmentError("align.part_before_start")
            if short:
                raise AlignmentError("align.part_short", duration_s=end - begin, count=fixes.time.shape[0])
            alignment, initial = aligned(samples, fixes, first=not parts)
        except AlignmentError as error:
            errors.append(error)
            code = Code.FILTER_PART_SHORT if short else Code.FILTER_PART_UNALIGNED
            code = Code.FILTER_PART_BEFORE_START if end <= begin_at else code
            n, why = fixes.time.shape[0], error.facts
            findings.append(Finding.of(code, begin, end, number=number, duration_s=end - begin, count=n, cause=why))
        else:
            parts.append(Part(after, alignment, initial))
            kept[span] = True
            tilt, heading, gap = alignment.sd[:2].max(), alignment.sd[2], begin - after if after < begin else np.nan
            findings += [
                Finding.of(Code.FILTER_PART, begin, end, gap_s=gap, limit_s=LONGEST_GAP, number=number),
                Finding.of(Code(alignment.level_method), initial.time, sd_rad=tilt),
                Finding.of(Code(alignment.heading_method), initial.time, sd_rad=heading),
            ]
    if not parts:
        raise errors[0]
    return imu.rows(kept), tuple(parts), findings


def spans(imu: ImuData) -> list[slice]:
    """Return the row ranges of the samples between gaps longer than `LONGEST_GAP`."""
    edges = [0, *(np.flatnonzero(spill.steps(imu.time) > LONGEST_GAP) + 1).tolist(), imu.time.shape[0]]
    return [slice(first, last) for first, last in pairwise(edges)]


def first_stationary(imu: ImuData, gps: GpsData) -> tuple[float, float] | None:
    """Find the first stationary interval from IMU and GPS: begin and end [s], or None."""
    gps = _resting(imu, _without_false_start(good_fixes(gps)))
    return stationary_of(strapdown.intervals(_first_part(imu, gps), strapdown.nominal_interval(imu.time)), gps)


def _check(imu: ImuData, gps: GpsData, start: Start | None) -> None:
    """Refuse a recording without fixes, or with an initial state outside the samples."""
    nominal = strapdown.nominal_interval(imu.time)
    if gps.time.shape[0] == 0:
        raise InputError("gps.no_fix")
    if start is None:
        return
    early = nominal + strapdown.TIME_TOLERANCE
    if not any(imu.time[part][0] - early <= start.time < imu.time[part][-1] for part in spans(imu)):
        samples_s = float(imu.time[0]), float(imu.time[-1])
        raise InputError("align.start_outside", start_s=start.time, samples_s=samples_s, parts=len(spans(imu)))


def _noise_of_fixes(
    imu: ImuData, gps: GpsData, receiver: Receiver, *, reported: bool
) -> tuple[Receiver, list[Finding]]:
    """Estimate velocity lag, time-correlated errors and timestamp jitter of a receiver, with findings."""
    notes = []
    lag, lag_sd = velocity_lag(gps)
    if abs(lag) > max(LAG_WORTH, 5.0 * lag_sd):
        receiver = replace(receiver, lag=Lag(lag))
        notes.append(name_lag(lag, lag_sd))
    correlated = correlated_noise(gps, receiver.lag.value, reported=reported)
    if correlated is not None:
        receiver = replace(receiver, correlated=correlated)
        code = Code.GPS_CORRELATED_REPORTED if correlated.by_reported else Code.GPS_CORRELATED_VELOCITY
        notes.append(Finding.of(code, share=correlated.share, time_s=correlated.time))
    step = np.diff(imu.time[: 1 << 16])
    jitter = float(np.std(step[step < strapdown.GAP * np.median(step)]))
    if jitter > JITTER_WORTH:
        receiver = replace(receiver, jitter=jitter)
        notes.append(Finding.of(Code.IMU_JITTER, jitter_s=jitter, limit_s=JITTER_WORTH))
    return receiver, notes


def good_fixes(gps: GpsData, gates: Gates | None = None) -> GpsData:
    """Return the fixes that pass the quality gate. Alignment uses only these."""
    gates = gates or Gates()
    keep = pass_quality(gates, gps)
    if not keep.any():
        least = float(gps.position_sd.max(axis=1).min())
        poor: dict[str, Any] = {"sd_m": least, "limit_m": gates.max_sd} if least > gates.max_sd else {"sd_m": np.nan}
        raise AlignmentError("gps.no_good_fix", **poor)
    return gps.rows(keep)


def _without_false_start(gps: GpsData) -> GpsData:
    """Drop the first fixes that contradict later fixes."""
    return gps.rows(slice(count_false_start(gps), None))


def _resting(imu: ImuData, gps: GpsData) -> GpsData:
    """Remove apparent motion of positions during a stationary start. Fixes with velocities need no such correction."""
    if motion.gives_velocities(gps):
        return gps
    nominal = strapdown.nominal_interval(imu.time)
    rest = stationary_of(strapdown.intervals(_first_part(imu, gps), nominal), gps)
    return without_false_motion(strapdown.intervals(imu.beginning(LONGEST_REST), nominal), gps, rest)


def _first_part(imu: ImuData, gps: GpsData) -> ImuData:
    """Return the samples up to `AFTER` the first motion in the fixes."""
    moving = motion.first_motion(motion.velocity(gps), float(imu.time[0]))
    if moving is None:
        return imu
    return imu.rows(slice(int(np.searchsorted(imu.time, moving + AFTER))))


def _at_fix(
    alignment: Alignment, parts: strapdown.Intervals, gps: GpsData, model: ErrorModel, receiver: Receiver
) -> InitialState:
    """Build the initial state at the fix nearest to the time of the alignment."""
    lever_b = receiver.lever_arm.value
    if lever_b.any():
        gps = motion.at_imu(gps, parts, alignment, lever_b)
    row = int(np.argmin(np.abs(gps.time - alignment.time)))
    alignment = replace(alignment, time=float(gps.time[row]))
    # an uncertain heading rotates the lever arm: the position error is at most its horizontal length
    horizontal = float(np.hypot(lever_b[0], lever_b[1]))
    position_sd = np.hypot(gps.position_sd[row], horizontal * min(float(alignment.sd[2]), 1.0))
    if alignment.static is not None:
        v_n, velocity_sd = np.zeros(3), np.full(3, STILL_SD)
    elif np.isfinite(gps.v_n[row]).all():
        v_n, velocity_sd = gps.v_n[row], np.hypot(gps.velocity_sd[row], START_VELOCITY_SD)
    else:
        v_n, velocity_sd = motion.start_velocity(parts, alignment, gps, receiver.lever_arm.sd)
        velocity_sd = np.hypot(velocity_sd, START_VELOCITY_SD)
    return initial_state(alignment, model, gps.lla[row], v_n, position_sd, velocity_sd, from_fix=True)
