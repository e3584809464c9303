"""What the reader of a run must not overlook, and what was taken for granted, what matters most first."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from insnav.alignment.static import CONTRADICTED, LONG_REST
from insnav.attitude import dcm_from_rph
from insnav.errors.evaluated_run import SAME_DATA, EvaluatedRun, failure
from insnav.errors.metrics import TrajectoryErrors, nees
from insnav.errors.reference_check import delay_shown, turned_in_place
from insnav.filter.gps_noise import heights_measured
from insnav.filter.innovation_likelihood import LARGEST
from insnav.filter.prepare import CORRELATED
from insnav.findings import Code, Finding, Severity
from insnav.input.readers.reading import not_covered
from insnav.messages import sentence
from insnav.plain_text import moment
from insnav.report.series import Clock
from insnav.result import Result
from insnav.tabular import runs_of
from insnav.types import FloatArray, Run, Trajectory
from insnav.units import DEG

HOLDS = 0.95  # share of errors inside 3 sd that needs no word
_LARGEST_SCALE = LARGEST["scale_factor"]["accel"]
_MANY = 0.1  # share of rejected fixes that wants an explanation
_MOST, _ONE_ROW = 0.5, 0.8  # the same where so large a part of them is one row: a fault that ended
_ROW, _ROW_TIME = 3, 1.9  # rejected fixes in a row, and over so long [s], that are more than chance
_LONG_GAP = 1.0  # of samples [s]: a car turns and brakes in it
_EXPLAINED = 0.5  # part of the epochs outside 3 sd that a constant difference must not leave, to be their cause
_AT_THE_LIMIT = 0.99  # part of the largest scale factor error that was looked for, where fixes and IMU do not fit
_ACROSS = 0.02  # part of what is about the other axes that such sensors show, too [-]
_TURN_ON = 2.0  # times the turn-on bias of such an IMU, that is none: clean drives have 1.4, of navigation grade 4 [-]
_ALONG, _MOVING = 0.5, 3.0  # resultant of what has no axis along the course, clean drives have 0.84 [-]; where, [m/s]
_UNUSED = 0.3  # part of the fixes that may lie before the start of navigation unsaid
_TURNED = 5.0 * DEG  # that headings in a rest may be off unseen [rad]
_PACE = 1.0  # over which turns and accelerations are those of the motion, not of vibration [s]
_OF_REFERENCE = (Code.REF_CONTRADICTION, Code.REF_OTHER)
_SLOW = (
    "gps: errors of positions that change slowly are as large as the sd of the fixes says; without velocities the "
    "drive shows only how fast they change"
)
# or done to the samples, as the drive shows, and how an IMU sits in a vehicle
_ASSUMED = re.compile(
    r"\bassumed\b|--imu-axes|added to the IMU times|IMU .*is turned .* in the vehicle|not go where|without the other"
)


def run_warnings(found: EvaluatedRun) -> tuple[str, ...]:
    """Warn of what makes a solution worse than it states."""
    stated, same = found.errors_on_clock, found.reference_is_gps
    names = {"filtered": "position", "smoothed": "smoothed position"}
    too_sure = [text for key, name in names.items() for text in overconfident(name, stated.get(key), same_data=same)]
    why, lost = failure(found.run), tuple(_lost_heading(found))
    warnings = (
        *([f"the solution is not to be used: {why}; IMU and fixes contradict each other"] if why else []),
        *lost,
        *(() if lost else _impossible_scale(found.run)),
        *([SAME_DATA] if found.reference_is_gps else []),
        *event_warnings(found.run),
        *_late(found.run),
        *(event.action for event in found.run.events if event.kind in _OF_REFERENCE),
        *_many_rejected(found.run),
        *(() if found.other_drive else too_sure[:1]),
        *_diverged(found.run),
        *_turned_at_rest(found.run),
        *_turned_in_place(found.best),
        *_begun_late(found.run),
        *_samples_lost(found.run),
        *_no_heights(found),
    )
    clock = Clock.of(found.run.solution.time)
    timed = [place for place, text in enumerate(warnings) if "t = " in text and abs(clock.start) > 1.0][:1]
    said = " (times in warnings are from the start)"
    return tuple(clock.tell(text) + said * (place in timed) for place, text in enumerate(warnings))


def file_warnings(result: Result[Any]) -> tuple[str, ...]:
    """Warn of files that are cut off, and of one that covers only a part of the other."""
    names = {source: Path(facts.path).name for source, facts in result.inputs.items()} | {"ref": "the reference"}
    lost = [(event.kind.removesuffix(".cut_row"), event.action) for event in result.events if "cut_row" in event.kind]
    cut = [f"{names.get(source, source)} is cut off: {action}" for source, action in lost]
    both = {"imu", "gps"} <= result.inputs.keys()
    return (*cut, *(not_covered(result.inputs["imu"], result.inputs["gps"]) if both else ()))


def event_warnings(run: Run) -> list[str]:
    """Fixes and samples that cannot both be right, and what was done about it."""
    events = run.events
    kinds = (Code.GPS_FROZEN, Code.CONTRADICTION)
    told = [event for event in events if event.kind in kinds or event.severity is Severity.WARNING]
    begun = run.solution.time[0] + 1.0
    # what is so all along, from the start, is a remark beside what went wrong somewhere
    found = [event.action for event in sorted(told, key=lambda event: bool(event.time < begun))]
    resets = [event for event in events if event.kind == Code.RESET]
    if resets:
        first = resets[0]
        found.append(
            f"the filter was reset to the fixes {_times(len(resets))}, first at {moment(first.time)} by "
            f"{first.value:.3g} m, after every position had been rejected for {first.limit:g} s"
            + "; those before or those after are false, smoothed standard deviations hold both"
            * (run.smoothed is not None)
        )
    return found


def _no_heights(found: EvaluatedRun) -> Iterator[str]:
    if found.gps is not None and not heights_measured(found.gps.lla):
        height = found.gps.lla[0, 2]
        why = "the fixes have no heights, or 0 m in every row:"
        if height:
            why = f"GPS heights are all {height:g} m: taken for not measured and"
        yield f"{why} not used; heights of the solution are unknown"


def _begun_late(run: Run) -> Iterator[str]:
    """A start long after the first fix, before which there is no solution: the drive did not tell the attitude."""
    outside = (event for event in run.events if event.kind is Code.GPS_OUTSIDE)
    early = sum(event.value for event in outside if event.time <= run.solution.time[0])
    every = early + run.innovations.time.size
    if early > _UNUSED * every:
        yield (
            f"the first {early:.0f} of {every:.0f} fixes are not used: the attitude is known only from then on; "
            "--static START:END or --initial FILE begin earlier"
        )


def _samples_lost(run: Run) -> Iterator[str]:
    """Samples that were no measurement, or missing for long: nothing but the uncertainty knows what happened there."""
    lost: dict[str, list[Finding]] = {}
    for event in run.events:
        if event.kind in (Code.IMU_STUCK, Code.IMU_SATURATED):
            lost.setdefault(event.action, []).append(event)
        elif event.kind == Code.IMU_GAP and event.value > _LONG_GAP:
            lost.setdefault("samples are missing: bridged like a data gap", []).append(event)
    for text, found in lost.items():
        what, _, how = text.partition(": ")
        length, how = sum(event.value for event in found), how.removeprefix("taken out, ")
        yield f"{what}: {_times(len(found))}, {length:.3g} s in all, first at {moment(found[0].time)}; {how}"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _many_rejected(run: Run) -> Iterator[str]:
    """So many fixes rejected that the fixes are hardly to blame, and nothing that names them."""
    fixes = run.innovations
    named = {event.kind for event in run.events}
    groups, rows = [], []
    for name, first, used, by in (
        ("position", 0, fixes.used_position, {Code.GPS_FROZEN, Code.GATE_RECORD_POSITION}),
        ("velocity", 3, fixes.used_velocity, {Code.GPS_FROZEN, Code.GATE_RECORD_VELOCITY}),
    ):
        if named & by:
            continue
        processed = np.isfinite(fixes.innovation[:, first : first + 3]).any(axis=1)
        time, rejected = fixes.time[processed], ~used[processed]
        found = [(stop - start, name, time[start], time[stop - 1]) for start, stop in runs_of(rejected)]
        rows += [each for each in found if each[0] >= _ROW and each[3] - each[2] >= _ROW_TIME]
        share = rejected.mean() if processed.any() else 0.0
        row = max(found)[0] if found else 0
        if share > (_MOST if row > _ONE_ROW * rejected.sum() else _MANY):
            groups.append(f"{100.0 * share:.0f} % of {name}")
    if groups:
        causes = "is a heading, lever arm, axis, clock or standard deviation wrong?"
        yield f"many fixes were rejected, {' and '.join(groups)}: {causes} See innovations and events"
    elif rows:
        _, name, start, stop = max(rows, key=lambda row: row[3] - row[2])
        more = f", and so it was {_times(len(rows) - 1)} for a shorter time" * (len(rows) > 1)
        yield f"every {name} from {moment(start, stop)} was rejected{more}: false fixes, or false samples"


def _late(run: Run) -> Iterator[str]:
    """Clocks of samples and fixes so far apart that the time of the solution is a question."""
    if delay := delay_shown(run):
        yield (
            f"the fixes are {abs(delay):.3f} s {'late' if delay > 0.0 else 'early'} against the samples: the solution "
            f"has the time of the fixes; where that of the samples is right, give --gps-delay {delay:.3f}"
        )


def overconfident(name: str, errors: TrajectoryErrors | None, *, same_data: bool) -> list[str]:
    """The reference is outside 3 sd much more often than it should be."""
    position = None if errors is None else (nees(errors) or {}).get("position")
    if errors is None or not position or position["inside_3_sd"] >= HOLDS:
        return []
    outside = 1.0 - position["inside_3_sd"]
    said = f"{name} is outside 3 sd at {100.0 * outside:.0f} % of the epochs; "
    if same_data:
        return [f"{said}positions and velocities of the fixes contradict each other, or the IMU"]
    constant = np.nanmedian(errors.position, axis=0)
    without = (nees(replace(errors, position=errors.position - constant)) or {}).get("position")
    if without and 1.0 - without["inside_3_sd"] < _EXPLAINED * outside:
        size = ", ".join(
            f"{each:+.3f} m {axis}" for each, axis in zip(constant, ("north", "east", "down"), strict=True)
        )
        rest = 100.0 * (1.0 - without["inside_3_sd"])
        return [
            f"{said}a constant difference of {size} makes most of them ({rest:.0f} % without it): is the datum, the "
            "height or the point of the reference another one?"
        ]
    return [f"{said}likely causes: time-correlated GPS errors, optimistic sigmas, reference errors"]


def _diverged(run: Run) -> Iterator[str]:
    found = [event for event in run.events if event.kind is Code.DIVERGED]
    for first in found[:1]:
        yield (
            f"innovations inconsistent with their predicted sd in {len(found)} window{'s' * (len(found) > 1)} of "
            f"1 min, first at {moment(first.time)}: {first.unit} = {first.value:.2g}; {first.hint}"
        )


def _turned_at_rest(run: Run) -> Iterator[str]:
    """A long rest whose mean rate the drive contradicts: a steady turn looks like a bias of the gyros.

    What is compared is the bias about down in the minutes after the vehicle has left.
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
        yield (
            f"the gyros' bias about down is {abs(rate) / DEG:.2g} deg/s off in the drive from that in the rest before: "
            f"the vehicle may have turned by {turn / DEG:.0f} deg in it, which headings there do not show"
        )


def _turned_in_place(track: Trajectory) -> Iterator[str]:
    """A vehicle that rolls, and turns where it stands."""
    turn = turned_in_place(track)
    if turn is not None:
        begin, end, angle = turn
        yield (
            f"the vehicle stands from {moment(begin, end)} and turns by {abs(angle) / DEG:.0f} deg: in its place, or a "
            "gyro was off, as headings before are then"
        )


def _lost_heading(found: EvaluatedRun) -> Iterator[str]:
    """A heading that turns about the course, with a gyro bias that such an IMU does not have.

    What drives forward and backward, or flies in wind, has its course near an axis: doubled angles have a long mean
    resultant (K. V. Mardia, P. E. Jupp, "Directional Statistics", Wiley 2000, 1.1). Drones may turn: the bias tells.
    """
    alignment = found.run.alignment
    at_rest = alignment.gyro_bias if alignment.static is not None else np.zeros(3)  # seen before, and no doubt of it
    bias = np.max(np.abs(found.run.sensor_errors.value[-1:, :3] - at_rest), initial=0.0)
    usual = [figure.prior for figure in found.noise.figures if figure.key == "gyro.bias"] if found.noise else []
    if not (usual and bias > _TURN_ON * usual[0]):
        return
    track = found.best.rows(np.hypot(*found.best.v_n[:, :2].T) > _MOVING)
    apart = track.rph[:, 2] - np.arctan2(track.v_n[:, 1], track.v_n[:, 0])
    if apart.size and abs(np.mean(np.exp(2j * apart))) < _ALONG:
        yield (
            f"the heading is lost: it turns about the direction of travel, with a gyro bias of {bias / DEG:.2g} deg/s, "
            f"{bias / usual[0]:.2g} times that of such an IMU. Attitude and its standard deviations are not to be "
            "used; likely causes: a gyro that is off for a while, or wrong axes, units or timestamps"
        )


def _impossible_scale(run: Run) -> Iterator[str]:
    """A scale factor surely beyond what a sensor, and this IMU, has: the state stands for what the model lacks.

    An axis about which, or along which, little happens shows no scale factor, but what it senses of the others.
    """
    if len(run.sensor_errors.time) == 0:
        return
    if float(np.max(run.sensor_errors.sd[0, 9:])) > _AT_THE_LIMIT * _LARGEST_SCALE:
        yield (
            "fixes and IMU agree only if the scale factors of its accelerometers are off by "
            f"{100.0 * _LARGEST_SCALE:.0f} % or more, which none are: check its units, axes and biases (insnav check)"
        )
        return
    value, sd = (each[-1, 6:] for each in (run.sensor_errors.value, run.sensor_errors.sd))
    own = _motion(run.solution)
    across = np.sqrt(np.repeat(np.sum(own.reshape(2, 3) ** 2, axis=1), 3) - own**2)
    sd = np.hypot(sd, _ACROSS * across / np.maximum(own, 1e-9))
    names = [f"{sensor} {axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz"]
    sure = np.abs(value) > np.maximum(_LARGEST_SCALE, run.sensor_errors.sd[0, 6:]) + 3.0 * sd
    found = [f"{name} {100.0 * error:+.0f} %" for name, error, said in zip(names, value, sure, strict=True) if said]
    if found:
        yield (
            f"scale factor errors larger than any sensor has: {', '.join(found)}; the drive has what the model lacks, "
            "such as velocities smoothed by the receiver, vibration, misalignment, wrong units or timestamps. "
            "Positions between fixes may be worse than stated"
        )


def _motion(track: Trajectory) -> FloatArray:
    """Root mean square of turning rate [rad/s] and acceleration [m/s^2] about and along the axes of the body, (6,)."""
    track = track.rows(np.unique(np.searchsorted(track.time, np.arange(track.time[0], track.time[-1], _PACE))))
    c, step = dcm_from_rph(track.rph), np.diff(track.time)[:, None]
    turned = np.swapaxes(c[:-1], 1, 2) @ c[1:]
    rate = np.column_stack([turned[:, k, j] - turned[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))]) / 2.0
    speed = np.einsum("kji,kj->ki", c[:-1], np.diff(track.v_n, axis=0))
    return np.asarray(np.sqrt(np.mean(np.hstack([rate, speed]) ** 2 / step**2, axis=0)))


def run_assumptions(result: Result[Any]) -> tuple[str, ...]:
    """Give what the drive shows of axes and clock, lever arm and IMU model unless given, and what files do not say."""
    evidence = {text: name for name, each in result.inputs.items() for text in each.evidence if _ASSUMED.search(text)}
    notes = tuple(
        sentence(each)
        for each in result.notes
        if (_ASSUMED.search(each) if isinstance(each, str) else each.severity is Severity.ASSUMPTION)
    )
    files = tuple(f"{name}: {text.replace('(assumed; ', '(')}" for text, name in evidence.items())
    return (*notes, *_not_given(result), *files)


def _not_given(result: Result[Any]) -> Iterator[str]:
    run, errors = result.found.run, result.found.errors
    given = {name for name, value in result.options.items() if value is not None}
    if errors is not None and "ref_lever_arm" not in given and not np.isfinite(errors.attitude).any():
        yield "the reference has no attitude, so its positions are of the antenna: else give --ref-lever-arm"
    known = "lever_arm" in given or np.any(run.lever_b) or np.any(run.lever_sd > 0.0)
    if not known and len(run.innovations.time):
        yield "lever arm zero, the antenna at the IMU: give it with lever_arm, --lever-arm"
    if result.imu_model is not None and given.isdisjoint(("imu", "imu_model")):
        spec, how = result.imu_model
        if not spec.name.endswith("as found"):  # in the innovations of the drive
            yield f"IMU model {spec.name}: {sentence(how)}"
    lasting = any(text.startswith(CORRELATED) for text in map(sentence, result.notes))
    sizes_given = not any("position sigma" in text for text in map(sentence, result.notes))
    if errors is None and lasting and sizes_given and not np.isfinite(run.innovations.nis_velocity).any():
        yield _SLOW
