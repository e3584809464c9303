"""Step 5: estimate the mounting of the IMU, and rotate the samples into vehicle axes."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from insnav import spill
from insnav.alignment.in_motion import sure_motion
from insnav.alignment.mounting import letters_of
from insnav.attitude import rph_from_quat, wrap_pi
from insnav.exceptions import AlignmentError, InputError
from insnav.filter.delay_and_lever import Filtered, filtered
from insnav.filter.innovation_likelihood import LONGEST
from insnav.findings import Code, Finding
from insnav.input import Reading
from insnav.input.interpret.physics import axes_matrix, check_axes, heading_convention, quiet_part, turns_with_course
from insnav.kernels.smoother import STATE
from insnav.steps import Estimate, Model, Recording
from insnav.steps.given import WORDS, accel_reversed, as_given, mounting_of, refusal, refuse_exchanged, set_up_filter
from insnav.steps.inputs import Inputs
from insnav.types import FloatArray, GpsData, ImuData, Source
from insnav.units import DEG

TURNED = 10.0 * DEG  # a smaller yaw of the IMU may be an effect of side slip or wind [rad]
UPRIGHT, INVERTED = "FRD", "FLU"
QUARTERS, QUARTER = (UPRIGHT, "RBD", "BLD", "LFD"), 0.5 * np.pi  # IMU axes: x forward, right, back or left
SLANTED = 20.0 * DEG  # beyond this angle from all vehicle axes, the IMU is not aligned with any of them
# cosine of the angle between z of the IMU and down: smaller if the IMU leans, and if it lies on its side
LEANING, ON_ITS_SIDE = 0.9, 0.5
CLEAR = 4.0 * DEG  # largest yaw sd for reporting the angles of a leaning IMU: two flights had 5 and 8 deg
POINTED = 0.9  # least length of the mean direction vector of a vehicle that moves along one axis [-]
LIKELY = 2.0  # largest mean normalised squared innovation for correct axes: ideally 1 [-]
LIKELIER = 30.0  # other axes must increase twice the log-likelihood by more than this [-]
X_FORWARD = Finding.of(Code.MOUNTING_ASSUMED, subject="imu")  # x is assumed to point forward


def mounting(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Rotate the samples into vehicle axes, unless axes were specified.

    Raises: InputError: axes are left-handed, gyros have wrong signs or order, or z is up and the vehicle is stationary.
    """
    inputs, fixes = recording.inputs, recording.fixes
    if as_given(inputs):
        assumed = (X_FORWARD,) * (inputs.get("axes") is None)
        return recording, replace(model, mounting_yaw=Estimate(0.0, 0.0, "prior" if assumed else "given")), assumed
    imu, yaw, findings = turn_to_vehicle(recording.imu, recording.fixes_by_scatter or fixes, inputs, recording.gps)
    recording, unknown = replace(recording, imu=imu), findings[-1:] == (X_FORWARD,)
    if unknown and fixes is not None and inputs.get("heading") is None and inputs.get("initial") is None:
        imu, yaw, finding = in_likely_axes(recording, model)
        findings = (*findings[:-1], finding) if imu is recording.imu else (finding,)
        recording, unknown = replace(recording, imu=imu), finding is X_FORWARD
    source: Source = "prior" if unknown else "data" if findings else "given"
    recording, headings = with_headings_turned(recording)
    return recording, replace(model, mounting_yaw=Estimate(yaw, 0.0, source)), (*findings, *headings)


def with_headings_turned(recording: Recording) -> tuple[Recording, tuple[Finding, ...]]:
    """Convert receiver headings to clockwise from north along the vehicle, and report the convention as read."""
    fixes, data = recording.fixes, recording.imu.data.beginning(LONGEST)
    if fixes is None or fixes.heading is None:
        return recording, ()
    count = int(np.isfinite(fixes.heading).sum())
    if not recording.inputs.get("gps_heading_sd"):
        return recording, (Finding.of(Code.GPS_HEADING_UNUSED, subject="gps", count=count),)
    turns = turns_with_course(data.time, data.gyro, data.accel, fixes.time, fixes.heading)
    sense, offset = heading_convention(turns, fixes.heading, fixes.v_n)
    if sense > 0.0 and offset == 0.0:
        return recording, ()
    heading = (sense * fixes.heading - offset) % (2.0 * np.pi)
    code = Code.GPS_HEADING_COUNTER_CLOCKWISE if sense < 0.0 else Code.GPS_HEADING_OFFSET
    finding = Finding.of(code, subject="gps", offset_rad=offset, count=count)
    return replace(recording, fixes=replace(fixes, heading=heading)), (finding,)


def turn_to_vehicle(
    imu: Reading[ImuData], fixes: GpsData | None, inputs: Inputs, gps: Reading[GpsData] | None = None
) -> tuple[Reading[ImuData], float, tuple[Finding, ...]]:
    """Rotate samples into vehicle axes if none were specified; return the yaw of the IMU [rad], and findings."""
    if fixes is None:
        return imu, 0.0, ()
    data, estimate = imu.data, mounting_of(imu, fixes)
    reverse = accel_reversed(imu, fixes, estimate)
    if reverse is not None or (estimate is not None and not estimate.right_handed):
        refuse_exchanged(imu, gps, fixes, estimate)
    if inputs.get("accel_sign") is None and reverse is not None:
        turned = replace(data, accel=spill.by_blocks(np.negative, data.accel))
        imu, yaw, findings = turn_to_vehicle(replace(imu, data=turned), fixes, {**inputs, "accel_sign": "minus-force"})
        return imu, yaw, (reverse, *findings)
    specified = inputs.get("axes")
    if estimate is None:
        from_file = bool(imu.facts.columns)  # samples from a file, whose axes are unknown
        moves = specified is None and sure_motion(fixes, float(data.time[0]))[1] is not None
        if specified is None and from_file and imu.facts.axes == UPRIGHT:
            scale = 1.0 / float(np.median(np.diff(data.time))) if data.sampling == "increment" else 1.0
            quiet = quiet_part(data.gyro, data.accel, interval=1.0 / imu.facts.rate_hz, scale=scale)
            try:
                check_axes(quiet, None, where=imu.facts.path)
            except InputError:
                if not moves:
                    raise
                imu, note = _turned(imu, axes_matrix(INVERTED), INVERTED, Code.MOUNTING_UPSIDE_DOWN)
                return imu, 0.0, (note, X_FORWARD)
        return imu, 0.0, (X_FORWARD,) * moves
    as_read = axes_matrix(specified or imu.facts.axes or UPRIGHT)
    if not estimate.right_handed:
        raise refusal(estimate.of_columns(axes_matrix(letters_of(as_read))), imu.facts)
    matrix, notes, windows = estimate.to_vehicle, [], estimate.windows
    letters, turn = letters_of(matrix @ as_read), axes_matrix(estimate.letters)
    # wind and banked turns tilt the estimate, too: a leaning IMU keeps its axes unless it lies on its side
    other_axes = estimate.letters != UPRIGHT and specified is None
    slanted = other_axes and (matrix @ turn.T)[2, 2] < LEANING and matrix[2, 2] > ON_ITS_SIDE
    if other_axes and not slanted:
        matrix, as_read = matrix @ turn.T, turn @ as_read
        imu, note = _turned(imu, turn, letters, Code.MOUNTING_ALONG_AXES, windows=windows)
        notes.append(note)
    remaining = replace(estimate, to_vehicle=matrix)
    yaw = float(remaining.angles[2])
    if specified is not None and remaining.letters != UPRIGHT:
        values = {"yaw_rad": yaw, "windows": windows, "given": specified, **_named(letters)}
        contradiction = Finding.of(Code.MOUNTING_CONTRADICTS_GIVEN, float(data.time[0]), subject="imu", **values)
        imu = replace(imu, events=(*imu.events, contradiction))
    elif slanted or abs(yaw) > max(TURNED, 4.0 * estimate.sd):
        angles = replace(estimate, to_vehicle=matrix @ as_read).angles / DEG
        axes = ",".join(f"{angle + 0.0:.1f}" for angle in angles) * (not slanted or estimate.sd < CLEAR)
        code = Code.MOUNTING_TILTED if slanted else Code.MOUNTING_YAW
        notes.append(Finding.of(code, subject="imu", yaw_rad=yaw, sd_rad=estimate.sd, windows=windows, axes=axes))
    else:
        yaw = 0.0
    return imu, yaw, tuple(notes)


def in_likely_axes(recording: Recording, model: Model) -> tuple[Reading[ImuData], float, Finding]:
    """Choose x forward, back, right or left by the likelihood of the fixes, if accelerations do not show the mounting.

    Slow vehicles turn but hardly accelerate, so a wrong x axis gives a heading wrong by quarter turns. The result
    is `X_FORWARD` if no other axes are more likely. An exception is a vehicle that, with all likely axes, travels along
    one and the same IMU direction other than x. A vehicle that does not travel along one axis, such as a drone, keeps
    its axes and starts with the most likely heading.
    """
    imu = recording.imu
    runs, first_part = dict[str, Filtered](), imu.data.beginning(LONGEST)
    for letters in QUARTERS:
        with suppress(AlignmentError, InputError):  # a later step reports errors of the axes as read
            data = _in_axes(first_part, axes_matrix(letters))
            runs[letters] = filtered(set_up_filter(replace(recording, imu=replace(imu, data=data)), model).ready)
    best = min(runs, key=lambda each: runs[each].misfit, default=UPRIGHT)
    # keep x forward if its run failed, the best run diverged, or the best axes are unlikely
    if UPRIGHT not in runs or runs[best].epochs is None or runs[best].squares >= LIKELY:
        return imu, 0.0, X_FORWARD
    fixes = runs[UPRIGHT].ready.gps.time.size
    limit = runs[best].misfit + LIKELIER / fixes
    travel_by_axes = {each: _travel(runs[each], QUARTERS.index(each)) for each in runs if runs[each].misfit <= limit}
    yaw, share = travel_by_axes[best]
    # if x forward is likely, too, replace it only if all likely axes agree on the yaw to the direction of travel
    agree = max(abs(wrap_pi(other - yaw)) for other, _ in travel_by_axes.values()) < SLANTED
    if UPRIGHT in travel_by_axes and not (agree and min(share for _, share in travel_by_axes.values()) > POINTED):
        return imu, 0.0, X_FORWARD
    if share < POINTED:
        note = Finding.of(Code.MOUNTING_TRAVEL_VARIES, subject="imu", share=share, limit_share=POINTED)
        return imu, QUARTERS.index(best) * QUARTER, note
    nearest, by_course = round(yaw / QUARTER), UPRIGHT in travel_by_axes
    gain = dict[str, Any]()
    if not by_course:
        gain = {"gain": fixes * (runs[UPRIGHT].misfit - runs[best].misfit), "limit_gain": LIKELIER}
    if abs(yaw - nearest * QUARTER) > SLANTED:
        code = Code.MOUNTING_YAW_COURSE if by_course else Code.MOUNTING_YAW_FIXES
        return imu, yaw, Finding.of(code, subject="imu", yaw_rad=yaw, **gain)
    if nearest == 0:
        return imu, 0.0, X_FORWARD
    turn = axes_matrix(QUARTERS[nearest % 4])
    letters = letters_of(turn @ axes_matrix(imu.facts.axes or UPRIGHT))
    code = Code.MOUNTING_ALONG_AXES_COURSE if by_course else Code.MOUNTING_ALONG_AXES_FIXES
    imu, note = _turned(imu, turn, letters, code, **gain)
    return imu, 0.0, note


def _travel(found: Filtered, quarter: int) -> tuple[float, float]:
    """Compute the IMU yaw against the direction of travel [rad], and the share of travel along it [-].

    The mean of doubled angles gives the axis of travel, also if the vehicle reverses (Mardia and Jupp, "Directional
    statistics", 2000, section 1.1). Forward is the direction of most travel.
    """
    if found.epochs is None:
        return 0.0, 0.0
    settled = found.epochs[found.epochs.shape[0] // 2 :, STATE : STATE + 10]  # second half: the heading has converged
    along = settled[:, 3] - 1j * settled[:, 4]
    ahead = np.exp(1j * rph_from_quat(settled[:, 6:])[:, 2]) * along * np.abs(along)
    size = np.maximum(np.abs(ahead), 1e-12)
    axis = np.sum(ahead**2 / size)
    forward = np.exp(0.5j * np.angle(axis))
    forward *= np.sign(np.sum((ahead / forward).real)) or 1.0
    return float(wrap_pi(quarter * QUARTER + np.angle(forward))), float(abs(axis) / np.sum(size))


def _turned(
    imu: Reading[ImuData], turn: FloatArray, letters: str, code: Code, **values: Any
) -> tuple[Reading[ImuData], Finding]:
    """Rotate samples into vehicle axes, and report the axes with `code`."""
    evidence = tuple(each for each in imu.facts.evidence if getattr(each, "code", None) is not Code.AXES_ASSUMED)
    facts = replace(imu.facts, axes=letters, evidence=evidence)
    note = Finding.of(code, subject="imu", **values, **_named(letters))
    return replace(imu, data=_in_axes(imu.data, turn), facts=facts), note


def _named(letters: str) -> dict[str, Any]:
    """Return the axes as for --imu-axes, and the vehicle direction of x, y and z in words."""
    return {"axes": letters, **{axis: WORDS[letter] for axis, letter in zip("xyz", letters, strict=True)}}


def _in_axes(data: ImuData, turn: FloatArray) -> ImuData:
    gyro, accel = (spill.by_blocks(lambda values: values @ turn.T, each) for each in (data.gyro, data.accel))
    return replace(data, gyro=gyro, accel=accel)
