"""Report on rate sweeps about three axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.lab.calibration import Calibration
from insnav.lab.rate_sweep.method import SweepCalibration
from insnav.lab.rate_sweep.records import SweepRecord
from insnav.messages import sentence
from insnav.quantity import Quantity
from insnav.report.calibration.common import corrected_section, impact_section, quality_rows, quality_section
from insnav.report.calibration.panels import sweep_panels
from insnav.report.numbers import number
from insnav.report.page import Page, Section, drawn, only_json
from insnav.sample_statistics import rms
from insnav.types import FloatArray
from insnav.units import DEG

AXES = ("x", "y", "z")


def sweep_page(calibration: Calibration[SweepRecord, SweepCalibration]) -> Page:
    """Report three gyros swept about three axes."""
    record, found, fits = calibration.record, calibration.detail, calibration.fits
    unit, scale = (record.unit, 1.0) if record.raw else ("deg/s", 1.0 / DEG)
    stages = (rms(found.error_line), rms(found.error_matrix), rms(found.error_map))
    settings = {name: _settings(found.rate[found.used[:, i]]) for i, name in enumerate(fits)}
    note = "given the pieces below, whose shape is not in the 1 sd" * any(item is not None for item in found.pieces)
    return Page(
        "Three gyros swept over rates about three axes",
        (
            f"Rate error, RMS over all dwells: {number(stages[0] / DEG)} deg/s by one line a gyro, "
            f"{number(stages[1] / DEG)} deg/s by the matrix, {_gain(found, stages)}.",
            *_dropped(found),
        ),
        (
            drawn("rate_errors", "Rate sweeps: error of each gyro", sweep_panels(found), columns=2),
            Section("parameters", "Output = B rate + b", calibration.parameters, note=note),
            _errors(found, stages),
            *_pieces(found),
            *_adjusted(found),
            quality_section(quality_rows(fits, unit, settings, scale)),
            corrected_section(calibration),
            impact_section(calibration),
            _details(found),
        ),
        calibration.warnings,
        (
            "The rate of the table is exact and about the axis named; the Earth's rotation along it is in the bias.",
            "The corrected rate is inverse(B) (output - b); its error is subtracted, k rate + b' in each piece.",
            "Beyond the swept rates the outer pieces are continued.",
        ),
    )


def _details(found: SweepCalibration) -> Section:
    condition = float(np.linalg.cond(found.matrix / np.diag(found.matrix)[:, None]))
    dropped = tuple(
        (Quantity("sensor", AXES[axis]), Quantity("rate_deg_s", item.rate), Quantity("code", item.reason.code.value))
        for axis, item in found.dropped
    )
    return only_json("", Quantity("condition_matrix", condition), parts=(Section("dropped", rows=dropped),))


def _dropped(found: SweepCalibration) -> list[str]:
    """What was left out, gyro by gyro and end by end."""
    lines = []
    for i, axis in enumerate(AXES):
        for sense in (-1.0, 1.0):
            rates = [item.rate for gyro, item in found.dropped if gyro == i and sense * item.rate > 0.0]
            if rates:
                first, last = min(rates, key=abs), max(rates, key=abs)
                reason = next(item.reason for gyro, item in found.dropped if gyro == i and item.rate == first)
                span = f"{first:+g}" + (f" to {last:+g}" if last != first else "")
                lines.append(f"gyro {axis} leaves out {span} deg/s: {sentence(reason)}")
    return lines


def _gain(found: SweepCalibration, stages: Sequence[float]) -> str:
    if all(item is None for item in found.pieces):
        return "which leaves nothing that a piecewise compensation could correct"
    _, before, after = stages
    less = f", {number(before / after, 2)} times smaller" if 0.0 < after < before else ""
    return f"{number(after / DEG)} deg/s with the piecewise compensation too{less}"


def _settings(rate: FloatArray) -> list[str]:
    texts = []
    for row in rate / DEG:
        turned = [f"{value:+.4g} deg/s about {axis}" for value, axis in zip(row, AXES, strict=True) if value != 0.0]
        texts.append(", ".join(turned) or "rest")
    return texts


def _errors(found: SweepCalibration, stages: Sequence[float]) -> Section:
    rows = []
    for i, axis in enumerate(AXES):
        item, final = found.pieces[i], found.error_map[:, i]
        worst = int(np.nanargmax(np.abs(final)))
        rows.append(
            (
                Quantity("gyro", axis),
                Quantity("line", rms(found.error_line[:, i]), "deg/s", meaning="own line, RMS"),
                Quantity("matrix", rms(found.error_matrix[:, i]), "deg/s"),
                Quantity("map", rms(final), "deg/s", meaning="matrix and pieces"),
                Quantity("left_out", None if item is None else rms(item.left_out), "deg/s"),
                Quantity("worst", abs(float(final[worst])), "deg/s"),
                Quantity("worst_at", _settings(found.rate[worst : worst + 1])[0], meaning="at"),
            )
        )
    note = (
        "own line: bias and scale factor of each gyro alone; left out: in its own sweep, each rate by pieces fitted "
        "without it"
    )
    of_all = (Quantity(name, value, "deg/s") for name, value in zip(("line", "matrix", "map"), stages, strict=True))
    table = Section("rate_error_by_gyro", "Error of the corrected rate", rows=tuple(rows), note=note, keyed=True)
    return Section("", parts=(table, only_json("rate_error", *of_all)))


def _adjusted(found: SweepCalibration) -> tuple[Section, ...]:
    """Intercepts set by hand, and what they change."""
    rows = tuple(
        (
            Quantity("piece", f"{AXES[each.gyro]}{each.piece + 1}"),
            Quantity("found", each.found, "deg/s", meaning="b' found", decimals=4),
            Quantity("given", each.given, "deg/s", meaning="b' given", decimals=4),
            Quantity("before", each.before, "deg/s", meaning="error in the piece, RMS, before"),
            Quantity("after", each.after, "deg/s"),
        )
        for each in found.adjusted
    )
    note = "the piece is moved, its neighbours stay and meet it at other borders; every other table is with it"
    return (Section("adjusted", "Set by hand", rows=rows, note=note, keyed=True),) if rows else ()


def _pieces(found: SweepCalibration) -> tuple[Section, ...]:
    """Pieces of the compensation as lines, and in JSON the errors at their ends."""
    known = {axis: item for axis, item in zip(AXES, found.pieces, strict=True) if item is not None}
    rows = tuple(
        (
            Quantity("gyro", axis),
            Quantity("piece", i + 1),
            Quantity("from", float(item.knot[i]), "deg/s", decimals=2),
            Quantity("to", float(item.knot[i + 1]), "deg/s", decimals=2),
            Quantity("k", float(slope), "ppm", sd=float(item.slope_sd[i])),
            Quantity("b", float(item.value[i] - slope * item.knot[i]), "deg/s", meaning="b'", decimals=4),
        )
        for axis, item in known.items()
        for i, slope in enumerate(item.slope)
    )
    knots = tuple(
        (
            Quantity("gyro", axis),
            Quantity("rate", item.knot, "deg/s"),
            Quantity("error", item.value, "deg/s"),
            Quantity("sd", np.sqrt(np.diag(item.covariance)), "deg/s"),
        )
        for axis, item in known.items()
    )
    note = "corrected rate from and to; they meet at the borders; beyond the outer ones the last piece goes on"
    return (
        Section("", "Pieces: error = k rate + b'", rows=rows, note=note),
        Section("pieces", rows=knots, show="json", keyed=True),
    )
