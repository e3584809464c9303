"""Reports of calibrations: page for any method, and the layout of multi-position and nine-position calibrations."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from insnav.imu import calibration_to_toml
from insnav.input.readers.reading import ReadingFacts
from insnav.lab.calibration import Calibration, measured
from insnav.lab.multi_position.many_positions import PosesCalibration
from insnav.lab.multi_position.method import POSITIONS, TURN_SD, TURNS, Found, SixPositions
from insnav.lab.multi_position.triad import AXES, Triad
from insnav.lab.nine_position import AXIS, SENSORS, NinePositions, NineRecord
from insnav.messages import phrase
from insnav.quantity import Quantity
from insnav.report.calibration import methods
from insnav.report.calibration.methods import Series
from insnav.report.page import DataFrame, Page, Section, by_warnings, drawn, only_json, rows_frame
from insnav.report.panels import Curve, Kind, Panel
from insnav.report.style import AXIS_COLOURS, BLUE, GREY, ORANGE, VERMILLION, number
from insnav.report.tables import of_columns, of_section, of_table
from insnav.result import Result
from insnav.sample_statistics import rms
from insnav.types import FloatArray
from insnav.units import DEG, G0

_MG, _MRAD = 1e-3 * G0, 1e-3
_MERITS = 6


def multi_position_page(calibration: Calibration[ReadingFacts, Found]) -> Page:
    """Lay out a multi-position calibration, from many poses or from six positions and three turns."""
    found = calibration.detail
    specific = _of_poses(found) if isinstance(found, PosesCalibration) else _of_six_positions(found)
    drawing, quality, all_positions, in_json = specific.sections
    without = "Without: one zero and one scale factor for three sensors." if found.counts else ""
    gravity = [Quantity("before", found.norm_before, "mg"), Quantity("after", found.norm_after, "mg")]
    if isinstance(found, PosesCalibration):
        gravity.append(Quantity("left_out", found.norm_left_out, "mg"))
    return Page(
        f"Multi-position calibration: {calibration.record.path}",
        specific.summary,
        (
            drawing,
            _triad("accel", "Accelerometers", found.accel, found.counts),
            _triad("gyro", "Gyros", found.gyro, found.counts),
            _g_sensitivity(found),
            only_json("gravity_error", *gravity),
            quality,
            methods.corrected_section(calibration),
            methods.impact_section(calibration, without),
            all_positions,
            only_json("", Quantity("gravity", found.g, "m/s^2"), parts=(in_json,)),
        ),
        merits=(
            *(
                replace(each, value=rms(np.asarray(each.value, np.float64)), meaning=f"gravity error, {each.label}")
                for each in gravity
            ),
            *specific.merits,
        ),
        merits_note="RMS over the positions; left out: by a calibration without the position",
        method=(*specific.method, *phrase("method.poses_and_six", gravity_m_s2=found.g).splitlines()),
    )


def _of_poses(found: PosesCalibration) -> Page:
    """Lay out the content specific to a calibration from poses; the long table of poses is only on the page."""
    turns = only_json(
        "turn_error", *of_table("calibration.turn_error", found, used=[bool(used) for used in found.turn_used])
    )
    all_poses = Section("", parts=(_poses(found), turns), show="page")
    times, used = np.array([[pose.start, pose.end] for pose in found.poses]), found.turn_used
    in_json = only_json("", Quantity("poses", times, "s"), Quantity("rest_limit_sd", found.factor))
    turn_errors = {"before": found.turn_before, "after": found.turn_after, "left out": found.turn_left_out}
    drawing = drawn("poses", "Gravity in every pose, and turns between them", poses_panels(found))
    return Page(
        "",
        (
            f"{_gravity_text(found)}; turns miss the next pose by {number(rms(found.turn_before[used]) / DEG)} deg "
            f"before, {number(rms(found.turn_after[used]) / DEG)} deg after.",
            f"{len(found.poses)} poses and {int(np.count_nonzero(used))} turns; stationary where the accelerometers "
            f"scatter less than {found.factor:g} times as in the quietest tenth.",
        ),
        (drawing, _quality(found), all_poses, in_json),
        method=tuple(phrase("method.poses", count=len(found.poses) - 9).splitlines()),
        merits=tuple(
            Quantity(f"turn_{name}", rms(values[used]), "deg", meaning=f"error of turn, {name}")
            for name, values in turn_errors.items()
        ),
    )


def _of_six_positions(found: SixPositions) -> Page:
    sections = only_json("sections", *(Quantity(name, list(span)) for name, span in found.sections.items()))
    all_positions = Section("", parts=(_positions(found), sections), show="page")
    in_json = only_json("", Quantity("position_tilt", found.tilt, "mrad"), Quantity("turn", found.angle, "deg"))
    drawing = drawn("positions", "Gravity in the six positions", positions_panels(found))
    worst_position = int(np.argmax(np.abs(found.norm_after)))
    worst = abs(float(found.norm_after[worst_position]))
    return Page(
        "",
        (
            f"{_gravity_text(found)}, worst {number(worst / _MG)} mg in position {POSITIONS[worst_position]}; position "
            f"errors are {number(found.tilt / _MRAD)} mrad (1 sd).",
            f"Six positions and three turns by {found.angle / DEG:g} deg.",
        ),
        (drawing, _turns(found), all_positions, in_json),
        method=tuple(phrase("method.six", turn_deg=found.angle / DEG, turn_sd_deg=TURN_SD / DEG).splitlines()),
        merits=(Quantity("position_tilt", found.tilt, "mrad", meaning="position errors, 1 sd"),),
    )


def _gravity_text(found: Found) -> str:
    before, after = (number(rms(values) / _MG) for values in (found.norm_before, found.norm_after))
    return f"Gravity error {before} mg before, {after} mg after (RMS)"


def _quality(found: PosesCalibration) -> Section:
    used = found.turn_used
    gravity = (found.norm_before, None, found.norm_after, found.norm_left_out)
    turns = (found.turn_before[used], found.turn_plain[used], found.turn_after[used], found.turn_left_out[used])
    columns = ("before", "without_g_sensitivity", "after", "left_out")
    rows = []
    for name, series, unit in (("gravity", gravity, "mg"), ("turn", turns, "deg")):
        for statistic, reduce in (("RMS", rms), ("worst", lambda v: float(np.abs(v).max()))):
            sizes = (None if values is None else reduce(values) for values in series)
            cells = (Quantity(column, size, unit) for column, size in zip(columns, sizes, strict=True))
            rows.append((Quantity("error", f"{name}, {statistic}"), *cells))
    return of_section("calibration.errors", rows)


def _poses(found: PosesCalibration) -> Section:
    forces = np.array([pose.force for pose in found.poses])
    up = np.linalg.solve(found.accel.matrix, (forces - found.accel.bias).T).T / found.g
    begin, end = np.array([[pose.start, pose.end] for pose in found.poses]).T
    texts = [" ".join(f"{v:+.2f}" for v in row) for row in up]
    columns = {"pose": map(str, itertools.count(1)), "from": begin, "for": end - begin, "f [g]": texts}
    sizes = {"before": found.norm_before, "after": found.norm_after, "share": found.accel_share}
    poses = of_columns("calibration.pose", **columns, **sizes)
    after = np.where(found.turn_used, found.turn_after, np.nan)
    share = found.gyro_share
    turns = of_columns("calibration.pose_turn", turn_before=found.turn_before, turn_after=after, turn_share=share)
    rows = tuple((*pose, *turn) for pose, turn in itertools.zip_longest(poses, turns, fillvalue=()))
    return of_section("calibration.pose", rows)


def _turns(found: SixPositions) -> Section:
    scale = np.diag(found.gyro.matrix)
    table = "calibration.turn_in_counts" if found.counts else "calibration.turn"
    return of_section(table, of_columns(table, turn=TURNS, before=found.turned, after=found.turned / scale))


def _positions(found: SixPositions) -> Section:
    first, last = zip(*(found.sections[name] for name in POSITIONS), strict=True)
    sizes = {"before": found.norm_before, "after": found.norm_after, "left": found.force_after}
    rows = of_columns("calibration.position", position=POSITIONS, first_sample=first, last_sample=last, **sizes)
    return of_section("calibration.position", rows)


def _triad(key: str, title: str, triad: Triad, counts: bool) -> Section:
    """Tabulate bias, scale factor and misalignment of three sensors with their sd; JSON has the matrices instead."""
    accel = key == "accel"
    si, shown = ("m/s^2", "mg") if accel else ("rad/s", "deg/s")
    bias_unit, matrix_unit = ("counts", f"counts/({si})") if counts else (si, "")
    rows = [
        (f"bias {axis}", Quantity("value", float(bias), "counts" if counts else shown, float(sd)))
        for axis, bias, sd in zip(AXES, triad.bias, triad.bias_sd, strict=True)
    ]
    for i, axis in enumerate(AXES):
        value, sd = float(triad.matrix[i, i]), float(triad.matrix_sd[i, i])
        if counts:
            per, unit = (G0, "counts/g") if accel else (DEG, "counts/(deg/s)")
            rows.append((f"scale factor {axis}", measured("value", value * per, unit, sd * per)))
        else:
            rows.append((f"scale factor error {axis}", Quantity("value", value - 1.0, "ppm", sd)))
    for i, j in itertools.permutations(range(3), 2):
        if triad.matrix_sd[i, j] > 0.0:
            scale = float(triad.matrix[i, i])
            across, sd = float(triad.matrix[i, j]) / scale, float(triad.matrix_sd[i, j]) / abs(scale)
            rows.append((f"{AXES[i]} senses {AXES[j]}", Quantity("value", across, "mrad", sd)))
    items = (
        Quantity("bias", triad.bias, bias_unit, triad.bias_sd),
        Quantity("matrix", triad.matrix, matrix_unit, triad.matrix_sd),
        Quantity("condition", triad.condition),
    )
    named = tuple((Quantity("parameter", name), value) for name, value in rows)
    table = Section("", title, rows=named, note=f"± 1 sd; condition number {triad.condition:.3g}")
    return Section(key, parts=(table, only_json("", *items)))


def _g_sensitivity(found: Found) -> Section:
    sensitivity, sd, counts = found.g_sensitivity, found.g_sensitivity_sd, found.counts
    unit, per = ("counts/g", G0) if counts else ("deg/s/g", G0 / DEG)
    rows = []
    for axis, *both in zip(AXES, sensitivity * per, sd * per, strict=True):
        cells = (measured(f"by {force}", value, unit, float(by)) for force, value, by in zip(AXES, *both, strict=True))
        rows.append((Quantity("gyro", axis), *cells))
    matrix = Quantity("g_sensitivity", sensitivity, "counts/(m/s^2)" if counts else "(rad/s)/(m/s^2)", sd)
    table = Section("", "g-sensitivity of the gyros", rows=tuple(rows), note="± 1 sd")
    return Section("", parts=(table, only_json("gyro", matrix)))


def nine_page(calibration: Calibration[NineRecord, NinePositions]) -> Page:
    """Lay out the calibration of three dual-axis sensor modules in nine positions."""
    found, fits = calibration.detail, calibration.fits
    # The parameters have this order: single accelerometers, accelerometer triad, gyro misalignment, gyros at rest.
    raw = calibration.record.unit != "m/s^2"
    single = 12 if raw else 6
    ends = itertools.pairwise((0, single, single + 9, single + 15, None))
    biases, accel, gyro, at_rest = (calibration.parameters[first:end] for first, end in ends)
    scales = " and scale factor" * raw
    across = "position, in the order of the file"
    panels = methods.residual_panels(_residuals(found, len(calibration.record.dwells.setting)), across)
    intervals = "1 sd of noise; the interval includes errors of second order"
    diagonal, second_order = ", ".join(f"{v:.5f}" for v in found.gyro_diagonal), number(1e3 * found.second_order, 2)
    places = [f"roll {roll:.4g}, pitch {pitch:.4g} deg" for roll, pitch in calibration.record.dwells.setting / DEG]
    largest = 1e3 * float(np.abs(found.gyro_matrix - np.eye(3)).max())
    half = 1e3 * float(found.half_width(found.gyro_matrix_sd, first_order=True).max())
    condition, positions = (found.condition_accel, found.condition_gyro), (str(len(places)), "all that are tilted")
    names = "A_m, accelerometers", "Omega_m, products"
    inverses = of_columns("calibration.inverse", matrix=names, condition=condition, positions=positions)
    return Page(
        "Nine positions of three dual-axis modules",
        (
            f"Gyro misalignment up to {number(largest)} mrad, known to ± {number(half, 2)} mrad (95 %); its inverse is "
            "applied by insnav.",
            f"Scatter of one accelerometer value {number(found.sigma / _MG, 2)} mg, {found.dof} degrees of freedom.",
        ),
        (
            drawn("residuals", "Nine positions: accelerometers minus the linear model", panels),
            Section("parameters", f"Bias{scales} of each accelerometer", biases, note=_methods(found)),
            Section("parameters", "Accelerometer triad, each axis the mean of its two accelerometers", accel),
            Section("parameters", "Gyro misalignment", gyro, note=intervals),
            Section("parameters", "Gyros at rest: bias and g-sensitivity", at_rest),
            Section("", "Pseudo-inverses", rows=inverses),
            methods.quality_section((fits, "m/s^2", dict.fromkeys(SENSORS, places))),
            methods.corrected_section(calibration),
            methods.impact_section(calibration),
            only_json("", *of_table("calibration.nine", found)),
        ),
        merits_note="x_ay: the accelerometer of module x that points along y",
        method=(
            *((phrase("method.nine_converted"),) * raw),
            *((phrase("method.nine_earth"),) * bool(at_rest)),
            *phrase("method.nine", second_order_mrad=second_order, diagonal=diagonal).splitlines(),
        ),
    )


def _residuals(found: NinePositions, places: int) -> Iterator[Series]:
    number, all_used = np.repeat(np.arange(1.0, places + 1.0), 2), np.ones(2 * places, dtype=np.bool_)
    for axis in range(3):
        residual = np.column_stack([found.fits[i].residual / _MG for i in np.flatnonzero(axis == AXIS)]).ravel()
        yield Series(f"both accelerometers {'xyz'[axis]}", "mg", number, residual, all_used, found.sigma / _MG)


def _methods(found: NinePositions) -> str:
    pairs = sorted({"xyz"[axis] for axis, pair in zip(AXIS, found.bias_opposite, strict=True) if pair})
    if not pairs:
        return "by least squares over all positions: no two have an axis along the vertical, up and down"
    return f"{', '.join(pairs)} from the two extreme positions, others by least squares over all"


def poses_panels(found: PosesCalibration) -> tuple[Panel, ...]:
    """Draw the gravity error in each pose, and the error of the measured turn from each pose to the next."""
    number = np.arange(1.0, len(found.poses) + 1.0)
    first = "one scale for all axes" if found.counts else "as recorded"
    used = found.turn_used
    gravity = [
        _size(first, number, found.norm_before / _MG, GREY),
        _size("calibrated", number, found.norm_after / _MG, BLUE),
        _size("left out", number, found.norm_left_out / _MG, ORANGE, "crosses"),
    ]
    between = number[:-1][used] + 0.5
    turns = [
        _size(first, between, found.turn_before[used] / DEG, GREY),
        _size("without g-sensitivity", between, found.turn_plain[used] / DEG, VERMILLION),
        _size("calibrated", between, found.turn_after[used] / DEG, BLUE),
        _size("left out", between, found.turn_left_out[used] / DEG, ORANGE, "crosses"),
    ]
    note = "left out: by a calibration without it"
    across = "number of the pose; turns between"
    return (
        Panel("gravity", "Error of gravity", "| |f| - g | [mg]", across, tuple(gravity), "pose", note, log="y"),
        Panel("turns", "Error of the turn to the next pose", "error [deg]", across, tuple(turns), "pose", log="y"),
    )


def _size(name: str, x: FloatArray, y: FloatArray, colour: str, kind: Kind = "points") -> Curve:
    """Build points for a logarithmic axis from absolute values, at least 1e-4: a simulated error may be zero."""
    return Curve(name, x, np.maximum(np.abs(y), 1e-4), colour, kind)


def positions_panels(found: SixPositions) -> tuple[Panel, ...]:
    """Draw the gravity error in the six positions, and the specific force error on each axis after calibration."""
    row = np.arange(len(POSITIONS), dtype=np.float64)
    names = tuple(f"{name[0]} {'up' if name.endswith('p') else 'down'}" for name in POSITIONS)
    first = "one scale for all axes" if found.counts else "as recorded"
    before = (
        Curve(first, found.norm_before / _MG, row, GREY, "points"),
        Curve("calibrated", found.norm_after / _MG, row, BLUE, "crosses"),
    )
    across = tuple(
        Curve("xyz"[axis], found.force_after[:, axis] / _MG, row, colour, "points")
        for axis, colour in enumerate(AXIS_COLOURS)
    )
    note = "tilt of the positions as measured by the level axes; opposite positions share it"
    return (
        Panel("gravity", "Error of gravity in each position", "", "|f| - g [mg]", before, rows=names),
        Panel("across", "Left after the calibration", "", "f - ideal [mg]", across, note=note, rows=names),
    )


# for each calibration method: the function that lays out its page, and the function that lists its input for JSON
_METHODS: Mapping[str, tuple[Callable[[Calibration[Any, Any]], Page], Callable[[Any], Any]]] = {
    "gyro": (methods.gyro_page, lambda records: methods.bench_input([each.table for each in records])),
    "accel": (methods.accel_page, lambda records: methods.bench_input([each.table for each in records])),
    "imu": (methods.sweep_page, lambda record: methods.bench_input(record.tables)),
    "nine": (nine_page, lambda record: methods.bench_input([record.table])),
    "poses": (multi_position_page, ReadingFacts.as_dict),
    "rotor": (methods.rotor_page, methods.bench_input),
}


def page(result: Result[Calibration[Any, Any]]) -> Page:
    """Lay out a calibration by any method, with its input, verdict and figures of merit."""
    found = result.found
    lay_out, input_of = _METHODS[found.method]
    by_method = lay_out(found)
    first, *sentences = by_method.summary
    return replace(
        by_method,
        summary=tuple(sentences),
        sections=(only_json("", Quantity("input", input_of(found.record))), *by_method.sections),
        verdict=by_warnings(first[0].upper() + first[1:], result.findings, ("good", "no warning from the fits")),
        merits=by_method.merits or tuple(replace(each, interval=None) for each in found.parameters[:_MERITS]),
    )


def texts(result: Result[Calibration[Any, Any]]) -> dict[str, str]:
    """Return the contents of ``calibration.toml``, if the method calibrates an IMU."""
    errors = result.found.errors
    return {} if errors is None else {"calibration.toml": calibration_to_toml(errors)}


def frame(result: Result[Calibration[Any, Any]]) -> DataFrame:
    """Build a table of the calibration parameters: a row per number, with unit and standard deviation."""
    return rows_frame(row for each in result.found.parameters for row in _numbers(each))


def _numbers(each: Quantity) -> tuple[tuple[Quantity, ...], ...]:
    """Split a parameter into the elements of its vector or matrix: a table row for each."""
    values, sds = np.broadcast_arrays(each.scaled(each.value), each.scaled(each.sd))
    names = (f"{each.label} {''.join('xyz'[k] for k in index)}".strip() for index in np.ndindex(values.shape))
    return of_columns(
        "calibration.number", parameter=names, unit=itertools.repeat(each.unit), value=values.flat, sd=sds.flat
    )
