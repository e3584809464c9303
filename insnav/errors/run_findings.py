"""Assessment of a finished run: problems beyond its stated uncertainty, and assumptions, most important first.

`insnav.result.Result` holds all findings in this order; pages and the terminal select them by severity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from insnav import findings
from insnav.alignment.static import CONTRADICTED, LONG_REST
from insnav.attitude import dcm_from_rph
from insnav.errors.evaluated_run import EvaluatedRun, failure
from insnav.errors.metrics import TrajectoryErrors, nees
from insnav.errors.reference_check import delay_shown, turned_in_place
from insnav.filter.gps_noise import heights_measured
from insnav.filter.innovation_likelihood import LARGEST
from insnav.findings import Code, Finding, Severity, of_code
from insnav.input.readers.reading import not_covered
from insnav.result import Result
from insnav.tabular import runs_of
from insnav.types import FloatArray, Run, Trajectory
from insnav.units import DEG

HOLDS = 0.95  # share of errors inside 3 sd without a finding
_LARGEST_SCALE = LARGEST["scale_factor"]["accel"]
_MANY = 0.1  # share of rejected fixes that requires an explanation
_MOST, _ONE_ROW = 0.5, 0.8  # the same, if this share of the rejected fixes is one run: a fault that ended
_ROW, _ROW_TIME = 3, 1.9  # length of a run of rejected fixes, and its duration [s], beyond chance
_LONG_GAP = 1.0  # of samples [s]: a car may turn and brake in it
_EXPLAINED = 0.5  # largest remaining share of epochs outside 3 sd, if a constant difference is their cause
_AT_THE_LIMIT = 0.99  # share of the search limit of scale factors, if fixes and IMU disagree
_ACROSS = 0.02  # share of the signal about other axes that such sensors sense [-]
_TURN_ON = 2.0  # multiple of the turn-on bias beyond plausibility: clean drives have 1.4, of navigation grade 4 [-]
_ALONG, _MOVING = 0.5, 3.0  # resultant of a heading unrelated to the course (clean drives: 0.84), from a speed [m/s]
_UNUSED = 0.3  # share of the fixes before the start of navigation without a finding
_TURNED = 5.0 * DEG  # unnoticed heading error at rest [rad]
_PACE = 1.0  # averaging time of turns and accelerations, against vibration [s]
_LOST = {
    Code.IMU_SATURATED: Code.RUN_SATURATED,
    Code.IMU_LIMITED: Code.RUN_LIMITED,
    Code.IMU_STUCK: Code.RUN_STUCK,
    Code.IMU_FROZEN: Code.RUN_STUCK,
    Code.ROWS_GAP: Code.RUN_GAPS,
}


def judged(result: Result[Any], run: EvaluatedRun) -> Result[Any]:
    """Add the findings about its run to a result, and sort all findings by importance.

    `result`: with the findings of the drive, the filter and the reference.
    """
    taken = [each for each in result.findings if each.severity is Severity.ASSUMPTION]
    of_files = [each for facts in result.inputs.values() for each in facts.evidence]
    ordered = (
        *run_warnings(run),
        *file_warnings(result),
        *taken,
        *_not_given(result, run),
        *(each for each in of_files if each.severity is Severity.ASSUMPTION),
        *result.findings,
    )
    return replace(result, findings=tuple(dict.fromkeys(ordered)))


def run_warnings(found: EvaluatedRun) -> tuple[Finding, ...]:
    """Report problems that make a solution worse than stated, most important first."""
    stated, same = found.errors_on_clock, found.reference_is_gps
    modes = "filtered", "smoothed"
    too_sure = [each for mode in modes for each in overconfident(mode, stated.get(mode))]
    unusable, lost = failure(found.run), tuple(_lost_heading(found))
    delay = delay_shown(found.run)  # beyond it, the clocks of samples and fixes leave no definite solution time
    of_drive, of_reference = event_warnings(found.run)
    return (
        *([unusable] if unusable else []),
        *lost,
        *(() if lost else _impossible_scale(found.run)),
        *([Finding.of(Code.REF_SAME_AS_GPS, subject="ref")] if same else []),
        *of_drive,
        *([Finding.of(Code.RUN_LATE_FIXES, subject="gps", delay_s=delay)] if delay else []),
        *of_reference,
        *_many_rejected(found.run),
        *(() if found.useless_reference else too_sure[:1]),
        *_diverged(found.run),
        *_turned_at_rest(found.run),
        *_turned_in_place(found.best),
        *_begun_late(found.run),
        *_samples_lost(found.run),
        *_no_heights(found),
    )


def file_warnings(result: Result[Any]) -> tuple[Finding, ...]:
    """Report truncated files, partly overlapping files, and problems of a drive."""
    both = {"imu", "gps"} <= result.inputs.keys()
    return (
        *of_code(result.findings, Code.ROWS_CUT),
        *(not_covered(result.inputs["imu"], result.inputs["gps"]) if both else ()),
        *(each for facts in result.inputs.values() for each in facts.evidence if each.severity >= Severity.WARNING),
        *(each for each in result.findings if not each.timed and each.severity >= Severity.WARNING),
    )


def event_warnings(run: Run) -> tuple[list[Finding], list[Finding]]:
    """Split findings into implausible fixes and samples, and implausible references."""
    begun = run.solution.time[0] + 1.0
    elsewhere = findings.SUMMED | {Code.ROWS_CUT}
    serious = [event for event in run.events if event.severity >= Severity.WARNING and event.code not in elsewhere]
    # a problem from the start is less serious than a later fault
    serious.sort(key=lambda event: not event.begin >= begun)
    of_drive = [event for event in serious if event.subject != "ref"]
    resets = list(of_code(run.events, Code.FILTER_RESET))
    for first in resets[:1]:
        of_drive.append(Finding.of(Code.RUN_RESET, first.begin, count=len(resets), distance_m=first.value))
    return of_drive, [event for event in serious if event.subject == "ref"]


def _no_heights(found: EvaluatedRun) -> Iterator[Finding]:
    if found.gps is not None and not heights_measured(found.gps.lla):
        height = float(found.gps.lla[0, 2])
        constant = Finding.of(Code.RUN_CONSTANT_HEIGHT, subject="gps", height_m=height)
        yield constant if height else Finding.of(Code.RUN_NO_HEIGHTS, subject="gps")


def _begun_late(run: Run) -> Iterator[Finding]:
    """Report a start long after the first fix: the drive did not determine the attitude before."""
    outside = of_code(run.events, Code.GPS_OUTSIDE)
    early = sum(event.value for event in outside if event.begin <= run.solution.time[0])
    every = early + run.innovations.time.size
    if early > _UNUSED * every:
        yield Finding.of(Code.RUN_LATE_START, float(run.solution.time[0]), count=int(early), of=int(every))


def _samples_lost(run: Run) -> Iterator[Finding]:
    """Report invalid samples, and long data gaps: only the uncertainty covers these times."""
    lost: dict[tuple[Code, str], list[Finding]] = {}
    for event in of_code(run.events, *_LOST):
        if event.code is not Code.ROWS_GAP or (event.subject == "imu" and event.value > _LONG_GAP):
            lost.setdefault((_LOST[event.code], event.subject), []).append(event)
    for (code, subject), events in lost.items():
        length = sum(event.value for event in events)
        yield Finding.of(code, events[0].begin, subject=subject, duration_s=length, count=len(events))


def _many_rejected(run: Run) -> Iterator[Finding]:
    """Report a large number of rejected headings, and of rejected fixes without a known cause."""
    for use in run.aiding:
        if use.name == "heading" and use.rejected > _MANY * use.processed:
            yield Finding.of(Code.RUN_HEADINGS_REJECTED, subject="gps", count=use.rejected, total=use.processed)
    fixes = run.innovations
    named = {event.code for event in run.events}
    shares: dict[str, Any] = {}
    rows = []
    for name, key, first, used, by in (
        ("position", "share", 0, fixes.used_position, findings.NOT_MEASURED | {Code.GATE_RECORD_POSITION}),
        ("velocity", "velocity_share", 3, fixes.used_velocity, findings.NOT_MEASURED | {Code.GATE_RECORD_VELOCITY}),
    ):
        if named & by:
            continue
        processed = np.isfinite(fixes.innovation[:, first : first + 3]).any(axis=1)
        time, rejected = fixes.time[processed], ~used[processed]
        found = [(stop - start, name, time[start], time[stop - 1]) for start, stop in runs_of(rejected)]
        rows += [each for each in found if each[0] >= _ROW and each[3] - each[2] >= _ROW_TIME]
        share = float(rejected.mean()) if processed.any() else 0.0
        row = max(found)[0] if found else 0
        if share > (_MOST if row > _ONE_ROW * rejected.sum() else _MANY):
            shares[key] = share
    if shares:
        yield Finding.of(Code.RUN_MANY_REJECTED, subject="gps", **shares)
    elif rows:
        _, name, start, stop = max(rows, key=lambda row: row[3] - row[2])
        others: dict[str, Any] = {"count": len(rows) - 1} if rows[1:] else {}
        yield Finding.of(Code.RUN_ROW_REJECTED, start, stop, subject=name, **others)


def overconfident(name: str, errors: TrajectoryErrors | None) -> list[Finding]:
    """Report errors outside 3 sd far more often than expected. `name`: of the solution."""
    position = None if errors is None else (nees(errors) or {}).get("position")
    if errors is None or not position or position["inside_3_sd"] >= HOLDS:
        return []
    outside = 1.0 - position["inside_3_sd"]
    constant = np.nanmedian(errors.position, axis=0)
    without = (nees(replace(errors, position=errors.position - constant)) or {}).get("position")
    if without and (rest := 1.0 - without["inside_3_sd"]) < _EXPLAINED * outside:
        offset = dict(zip(("north_m", "east_m", "down_m"), constant.tolist(), strict=True))
        return [Finding.of(Code.RUN_OVERCONFIDENT_OFFSET, subject=name, share=outside, rest=rest, **offset)]
    return [Finding.of(Code.RUN_OVERCONFIDENT, subject=name, share=outside)]


def _diverged(run: Run) -> Iterator[Finding]:
    windows = list(of_code(run.events, Code.FILTER_DIVERGED))
    for first in windows[:1]:
        yield Finding.of(Code.RUN_DIVERGED, first.begin, subject=first.subject, nis=first.value, count=len(windows))


def _turned_at_rest(run: Run) -> Iterator[Finding]:
    """Report a long stationary period whose mean rate the drive contradicts: a steady turn resembles gyro bias.

    The comparison uses the bias about down in the minutes after departure.
    """
    at, errors = run.alignment, (run.smoothed or run).sensor_errors
    after = (errors.time > at.left) & (errors.time < at.left + LONG_REST)
    if at.static is None or not at.sway.size or not after.any():
        return
    down = dcm_from_rph(at.rph)[2]
    rate = float((at.gyro_bias - np.median(errors.value[after, :3], axis=0)) @ down)
    sd = float(np.hypot(at.gyro_bias_sd @ np.abs(down), np.median(errors.sd[after, :3], axis=0) @ np.abs(down)))
    turn = abs(rate) * (at.left - at.static[0])
    if abs(rate) > CONTRADICTED * sd and turn > _TURNED:
        begin, limit = float(at.static[0]), CONTRADICTED * sd
        yield Finding.of(
            Code.RUN_TURNED_AT_REST, begin, float(at.left), rate_rad_s=abs(rate), limit_rad_s=limit, angle_rad=turn
        )


def _turned_in_place(track: Trajectory) -> Iterator[Finding]:
    """Report a wheeled vehicle that turns while stationary."""
    turn = turned_in_place(track)
    if turn is not None:
        begin, end, angle = turn
        yield Finding.of(Code.RUN_TURNED_IN_PLACE, begin, end, angle_rad=angle)


def _lost_heading(found: EvaluatedRun) -> Iterator[Finding]:
    """Report a heading that rotates relative to the course, with an implausible gyro bias.

    A vehicle that reverses or flies in wind has its course near an axis: doubled angles have a long mean resultant (K.
    V. Mardia, P. E. Jupp, "Directional Statistics", Wiley 2000, 1.1). Drones may turn: only the bias decides.
    """
    alignment = found.run.alignment
    at_rest = alignment.gyro_bias if alignment.static is not None else np.zeros(3)  # observed at rest, so certain
    bias = np.max(np.abs(found.run.sensor_errors.value[-1:, :3] - at_rest), initial=0.0)
    usual = [figure.prior for figure in found.noise.figures if figure.key == "gyro.bias"] if found.noise else []
    if not (usual and bias > _TURN_ON * usual[0]):
        return
    track = found.best.rows(np.hypot(*found.best.v_n[:, :2].T) > _MOVING)
    apart = track.rph[:, 2] - np.arctan2(track.v_n[:, 1], track.v_n[:, 0])
    if apart.size and abs(np.mean(np.exp(2j * apart))) < _ALONG:
        limit = _TURN_ON * usual[0]
        yield Finding.of(Code.RUN_HEADING_LOST, rate_rad_s=bias, limit_rad_s=limit, ratio=bias / usual[0])


def _impossible_scale(run: Run) -> Iterator[Finding]:
    """Report a scale factor significantly beyond the sensor type: the state absorbs a model error.

    An axis with little signal determines no scale factor, but senses cross-axis signals.
    """
    if len(run.sensor_errors.time) == 0:
        return
    if float(np.max(run.sensor_errors.sd[0, 9:])) > _AT_THE_LIMIT * _LARGEST_SCALE:
        yield Finding.of(Code.RUN_SCALE_OF_ALL, subject="imu", share=_LARGEST_SCALE)
        return
    value, sd = (each[-1, 6:] for each in (run.sensor_errors.value, run.sensor_errors.sd))
    own = _motion(run.solution)
    across = np.sqrt(np.repeat(np.sum(own.reshape(2, 3) ** 2, axis=1), 3) - own**2)
    sd = np.hypot(sd, _ACROSS * across / np.maximum(own, 1e-9))
    names = [f"{sensor} {axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz"]
    sure = np.abs(value) > np.maximum(_LARGEST_SCALE, run.sensor_errors.sd[0, 6:]) + 3.0 * sd
    if sure.any():
        axes = tuple(name for name, impossible in zip(names, sure, strict=True) if impossible)
        yield Finding.of(Code.RUN_SCALE, subject="imu", share=tuple(value[sure]), limit_share=_LARGEST_SCALE, axes=axes)


def _motion(track: Trajectory) -> FloatArray:
    """Compute RMS turn rate [rad/s] and acceleration [m/s^2] about and along the body axes, (6,)."""
    track = track.rows(np.unique(np.searchsorted(track.time, np.arange(track.time[0], track.time[-1], _PACE))))
    c, step = dcm_from_rph(track.rph), np.diff(track.time)[:, None]
    turned = np.swapaxes(c[:-1], 1, 2) @ c[1:]
    rate = np.column_stack([turned[:, k, j] - turned[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))]) / 2.0
    speed = np.einsum("kji,kj->ki", c[:-1], np.diff(track.v_n, axis=0))
    return np.asarray(np.sqrt(np.mean(np.hstack([rate, speed]) ** 2 / step**2, axis=0)))


def _not_given(result: Result[Any], found: EvaluatedRun) -> Iterator[Finding]:
    """Report assumptions where neither user nor data provide a value."""
    run, errors = found.run, found.errors
    given = {name for name, value in result.options.items() if value is not None}
    point_known = "ref_lever_arm" in given or any(of_code(run.events, Code.REF_HEADING_MISREAD, Code.REF_TILT_MISREAD))
    if errors is not None and not point_known and not np.isfinite(errors.attitude).any():
        yield Finding.of(Code.REF_AT_ANTENNA, subject="ref")
    arm_known = "lever_arm" in given or np.any(run.lever_b) or np.any(run.lever_sd > 0.0)
    if not arm_known and len(run.innovations.time):
        yield Finding.of(Code.RUN_LEVER_ZERO)
    if result.imu_model is not None and result.imu_model[1].severity is Severity.ASSUMPTION:
        yield result.imu_model[1]
    noted = {each.code for each in result.findings}
    of_receiver = noted & findings.CORRELATED_POSITIONS and not noted & findings.ASSUMED_POSITION_SD
    if errors is None and of_receiver and not np.isfinite(run.innovations.nis_velocity).any():
        yield Finding.of(Code.RUN_SLOW_ERRORS, subject="gps")
