"""Page and facts of a multi-position calibration: poses and turns, or six positions and three turns."""

from __future__ import annotations

from typing import Any

import numpy as np

from insnav.input.readers.reading import Reading
from insnav.lab.calibration import Calibration
from insnav.lab.multi_position.many_positions import PosesCalibration
from insnav.lab.multi_position.method import Found
from insnav.lab.multi_position.six_positions import POSITIONS, TURN_SD, TURNS, SixPositions
from insnav.report.calibration.multi_position_figures import draw_poses, draw_six_positions
from insnav.report.calibration.page import corrected_table, impact_facts, impact_table
from insnav.report.calibration.triad import g_table, triad_table
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.run_json import json_ready
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.sample_statistics import rms
from insnav.types import ImuData
from insnav.units import DEG, G0

_MG, _MRAD = 1e-3 * G0, 1e-3


def poses_report(calibration: Calibration[Reading[ImuData], Found]) -> tuple[Sheet, dict[str, Any]]:
    """Page and facts of a multi-position calibration."""
    return _sheet(calibration), _facts(calibration)


def _facts(calibration: Calibration[Reading[ImuData], Found]) -> dict[str, Any]:
    found, how = calibration.detail, calibration.options
    configuration = {
        "method": "six" if how.six else "poses",
        "counts": how.counts,
        "gravity_m_s2": how.gravity,
        "gravity": how.gravity_source,
    }
    unit = ("counts", "counts_per_") if found.counts else ("", "")
    facts: dict[str, Any] = {
        "configuration": configuration,
        "input": calibration.record.facts.as_dict(),
        "gravity_m_s2": found.g,
    }
    for sensor, si, triad in (("accel", "m_s2", found.accel), ("gyro", "rad_s", found.gyro)):
        matrix = f"matrix_{unit[1]}{si}" if found.counts else "matrix"
        facts[sensor] = {
            f"bias_{unit[0] or si}": triad.bias.tolist(),
            f"bias_sd_{unit[0] or si}": triad.bias_sd.tolist(),
            matrix: triad.matrix.tolist(),
            f"{matrix}_sd": triad.matrix_sd.tolist(),
            "condition": triad.condition,
        }
    g_unit = "counts_per_m_s2" if found.counts else "rad_s_per_m_s2"
    facts["gyro"][f"g_sensitivity_{g_unit}"] = found.g_sensitivity.tolist()
    facts["gyro"][f"g_sensitivity_sd_{g_unit}"] = found.g_sensitivity_sd.tolist()
    facts["gravity_error_mg"] = {
        "before": (found.norm_before / _MG).tolist(),
        "after": (found.norm_after / _MG).tolist(),
    }
    if isinstance(found, PosesCalibration):
        facts["method"] = "poses"
        facts["gravity_error_mg"]["left_out"] = (found.norm_left_out / _MG).tolist()
        facts["turn_error_deg"] = {
            "before": (found.turn_before / DEG).tolist(),
            "without_g_sensitivity": (found.turn_plain / DEG).tolist(),
            "after": (found.turn_after / DEG).tolist(),
            "left_out": (found.turn_left_out / DEG).tolist(),
            "used": found.turn_used.tolist(),
        }
        facts["poses_s"] = [[pose.start, pose.end] for pose in found.poses]
        facts["rest_limit_sd"] = found.factor
    else:
        facts["method"] = "six positions"
        facts["sections"] = {name: list(span) for name, span in found.sections.items()}
        facts["position_tilt_mrad"] = found.tilt / _MRAD
        facts["turn_deg"] = found.angle / DEG
    facts["minute"] = impact_facts(calibration)
    facts["warnings"] = list(calibration.warnings)
    ready: dict[str, Any] = json_ready(facts)
    return ready


def _sheet(calibration: Calibration[Reading[ImuData], Found]) -> Sheet:
    """Its last table lists every pose: too long for a terminal."""
    found = calibration.detail
    tables = [
        triad_table("Accelerometers", found.accel, found.counts, accel=True),
        triad_table("Gyros", found.gyro, found.counts, accel=False),
        g_table(found.g_sensitivity, found.g_sensitivity_sd, found.counts),
    ]
    without = "Without: one zero and one scale factor for three sensors." if found.counts else ""
    impact = (corrected_table(calibration), impact_table(calibration, without))
    general = (
        f"Gravity is {found.g:.5f} m/s^2; accelerometer scale factors are as good as that.",
        "A positive output is a positive specific force (an axis pointing up) and a positive rate.",
        "The Earth's rotation (15 deg/h) is neglected; biases are those of this time since switching on.",
    )
    with drawing():
        if isinstance(found, PosesCalibration):
            summary = _poses_summary(found)
            tables += [_quality_table(found), *impact, _poses_table(found)]
            picture = Picture("poses", draw_poses(found), "Gravity in every pose, and turns between them")
            assumed: tuple[str, ...] = (
                "Body x is the sensitive axis of accelerometer x; body y lies in the plane of x and y.",
                "Standard deviations come from the scatter of the residuals, "
                f"{len(found.poses) - 9} degrees of freedom for the accelerometers.",
                "Method: Tedaldi, Pretto, Menegatti (ICRA 2014), plus the gyros' g-sensitivity from the rests.",
            )
        else:
            summary = _six_summary(found)
            tables += [_turns_table(found), *impact, _positions_table(found)]
            picture = Picture("positions", draw_six_positions(found), "Gravity in the six positions")
            assumed = (
                f"Turns are by {found.angle / DEG:g} deg within {TURN_SD / DEG:g} deg (1 sd), to either side.",
                "Axes are those of the housing, as good as it stood: off the diagonal that is the uncertainty.",
                "Method: Ferraris, Grimaldi, Parvis (1995).",
            )
    return Sheet(
        f"Multi-position calibration: {calibration.record.facts.path}",
        summary,
        tuple(tables),
        (picture,),
        (*assumed, *general),
        calibration.warnings,
    )


def _poses_summary(found: PosesCalibration) -> tuple[str, ...]:
    used = found.turn_used
    return (
        f"{len(found.poses)} poses and {int(np.count_nonzero(used))} turns; rest is where the accelerometers scatter "
        f"less than {found.factor:g} times as in the quietest tenth.",
        f"{_gravity_text(found)}; turns miss the next pose by {number(rms(found.turn_before[used]) / DEG)} deg "
        f"before, {number(rms(found.turn_after[used]) / DEG)} deg after.",
    )


def _gravity_text(found: Found) -> str:
    before, after = (number(rms(values) / _MG) for values in (found.norm_before, found.norm_after))
    return f"Gravity error {before} mg before, {after} mg after (RMS)"


def _six_summary(found: SixPositions) -> tuple[str, ...]:
    place = int(np.argmax(np.abs(found.norm_after)))
    worst = float(np.abs(found.norm_after[place]))
    return (
        f"Six positions and three turns by {found.angle / DEG:g} deg.",
        f"{_gravity_text(found)}, worst {number(worst / _MG)} mg in position {POSITIONS[place]}; positions are off by "
        f"{number(found.tilt / _MRAD)} mrad (1 sd).",
    )


def _quality_table(found: PosesCalibration) -> Table:
    used = found.turn_used
    gravity = (found.norm_before, None, found.norm_after, found.norm_left_out)
    turns = (found.turn_before[used], found.turn_plain[used], found.turn_after[used], found.turn_left_out[used])
    rows = []
    for title, series, unit in (("gravity [mg]", gravity, _MG), ("turn [deg]", turns, DEG)):
        for how, reduce in (("RMS", rms), ("worst", lambda v: float(np.abs(v).max()))):
            rows.append(
                (f"{title}, {how}", *(number(None if values is None else reduce(values) / unit) for values in series))
            )
    return Table(
        "Errors",
        ("", "before", "without g-sensitivity", "after", "left out"),
        tuple(rows),
        "left out: every fifth at a time, by a calibration without them",
    )


def _poses_table(found: PosesCalibration) -> Table:
    up = (
        np.linalg.solve(found.accel.matrix, (np.array([p.force for p in found.poses]) - found.accel.bias).T).T / found.g
    )
    rows = []
    for i, pose in enumerate(found.poses):
        last = i == len(found.poses) - 1
        rows.append(
            (
                str(i + 1),
                f"{pose.start:.2f}",
                f"{pose.end - pose.start:.2f}",
                " ".join(f"{v:+.2f}" for v in up[i]),
                f"{found.norm_before[i] / _MG:+.2f}",
                f"{found.norm_after[i] / _MG:+.3f}",
                f"{100.0 * found.accel_share[i]:.0f}",
                "–" if last else number(found.turn_before[i] / DEG),
                "–" if last or not found.turn_used[i] else number(found.turn_after[i] / DEG),
                "–" if last else f"{100.0 * found.gyro_share[i]:.0f}",
            )
        )
    return Table(
        "Poses, and the turn from each to the next",
        (
            "pose",
            "from [s]",
            "for [s]",
            "f [g]",
            "before [mg]",
            "after [mg]",
            "tells [%]",
            "turn before [deg]",
            "after [deg]",
            "tells [%]",
        ),
        tuple(rows),
        "tells: how much of one parameter this pose or turn determines by itself; all add up to nine parameters",
    )


def _turns_table(found: SixPositions) -> Table:
    scale = np.diag(found.gyro.matrix)
    unit, size = ("counts s", 1.0) if found.counts else ("deg", DEG)
    rows = tuple(
        (name, number(found.turned[i] / size, 6), number(found.turned[i] / scale[i] / DEG, 6))
        for i, name in enumerate(TURNS)
    )
    return Table("Turns, as their own gyro has them", ("", f"before [{unit}]", "after [deg]"), rows)


def _positions_table(found: SixPositions) -> Table:
    rows = tuple(
        (
            name,
            str(found.sections[name][0]),
            str(found.sections[name][1]),
            f"{found.norm_before[i] / _MG:+.2f}",
            f"{found.norm_after[i] / _MG:+.3f}",
            " ".join(f"{v / _MG:+.2f}" for v in found.force_after[i]),
        )
        for i, name in enumerate(POSITIONS)
    )
    return Table(
        "Positions",
        ("", "first sample", "last + 1", "|f| - g before [mg]", "after [mg]", "f - ideal, after [mg]"),
        rows,
    )
