"""Drift of gyros before and after: report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from insnav.lab.bench_data.bench_tables import BenchTable
from insnav.lab.drift.allan_before_after import POWERS, Curve, DriftStudy, GyroDrift
from insnav.lab.drift.drift_model import DriftModel
from insnav.lab.drift.rate_smoothing import P0, RampAnswer
from insnav.report.calibration.page import Parameter, condition_warnings, fit_facts, parameter_table, quality_table
from insnav.report.drift.figures import draw_drift
from insnav.report.noise.page import GYRO_UNITS
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.run_json import json_ready
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.units import DEG, DEG_PER_H, G0

_TERMS = {
    "A": ("bias at 25 C, A", "deg/s", DEG),
    "B": ("residual scale factor, B", "ppm", 1e-6),
    "c_T": ("temperature, c_T", "deg/s/C", DEG),
    "c_g": ("g-sensitivity, c_g", "deg/s/g", DEG / G0),
}
ASSUMPTIONS = (
    "drift = A + B rate + c_T (T - 25 C) + c_g a by least squares over the whole record; standard deviations with what "
    "the residuals have in common from sample to sample (means of parts of the record, up to a twelfth of it)",
    "the true rate is that of the columns rate_x_deg_s …, zero without them; A has the Earth's rotation along the axis "
    "in it, at most 0.0042 deg/s, and so has it whatever a term that is left out makes in this record",
    "scalar Kalman filter: transition 1, observation 1, initial state 0 with variance 1 (deg/s)²; Q and R are those of "
    "greatest likelihood of the random part at rest, taken as random walk plus white noise (Harvey 1989); Q not below "
    "what a time constant of a tenth of that part has",
    "overlapping Allan deviation; intervals 95 %, chi-square with the degrees of freedom of white noise and random "
    "walk of these R and Q, smoothed: a Gauss-Markov process and the walk",
    "Q, N, B, K, R from sigma² = sum of A_m tau^m, m = -2 .. 2, by generalised least squares over the times of the "
    "table (IEEE Std 952-1997, annex C); no term is dropped, so a negative A_m is shown as –",
)


def drift_report(found: DriftStudy, table: BenchTable) -> tuple[Sheet, dict[str, Any]]:
    """Report on the drift of gyros.

    Parameters
    ----------
    found : DriftStudy
    table : BenchTable
        The input.

    Returns
    -------
    Sheet, dict
        The page, and the facts for ``run.json``.
    """
    record, gyros = found.record, found.gyros
    fits = {f"gyro {each.model.axis}": each.model.fit for each in gyros}
    rest = gyros[0].rest
    with drawing():
        figure = draw_drift(found)
    warnings = (*found.warnings, *condition_warnings(fits))
    sheet = Sheet(
        f"Drift of the gyros of {table.name}",
        (
            f"{record.time.size} samples at {1.0 / record.interval:.6g} Hz, "
            f"the first {rest.stop * record.interval:g} s at rest",
            *(text for each in gyros for text in _plainly(each)),
        ),
        (
            parameter_table("Drift model", [p for each in gyros for p in _parameters(each.model)]),
            _filters(gyros),
            *(_curves(each) for each in gyros),
            _coefficients(gyros),
            _ramps(gyros),
            quality_table(fits, "rad/s", {name: _times(record.time) for name in fits}),
        ),
        (Picture("drift", figure, "Random part, Allan deviation and rate ramp before and after."),),
        (*ASSUMPTIONS, *found.notes),
        warnings,
    )
    return sheet, _facts(found, table, fits, warnings)


def _plainly(each: GyroDrift) -> tuple[str, ...]:
    name, corrected, smoothed = f"gyro {each.model.axis}", each.corrected, each.smoothed
    shortest, longest = float(corrected.allan.tau[0]), float(corrected.allan.tau[-1])
    lower = float(corrected.deviation[0] / smoothed.deviation[0])
    ratio = float(smoothed.deviation[-1] / corrected.deviation[-1])
    return (
        f"{name}: smoothing lowers the Allan deviation at {shortest:g} s by a factor of {number(lower, 2)}, and up to "
        f"{each.helped_until:g} s; at {longest:g} s ({number(float(corrected.freedom[-1]), 2)} degrees of freedom) it "
        f"is {number(ratio, 2)} times that of the corrected rate.",
        f"{name}: it delays the rate by {number(each.smoother.lag)} s. It cannot remove bias instability: whatever "
        "changes more slowly than the filter passes through it.",
    )


def _parameters(model: DriftModel) -> list[Parameter]:
    found = []
    for term, value in model.value.items():
        name, unit, factor = _TERMS[term]
        found.append(
            Parameter(
                f"gyro {model.axis} {name}",
                value / factor,
                model.sd[term] / factor,
                model.half_width(term) / factor,
                unit,
            )
        )
    return found


def _filters(gyros: Sequence[GyroDrift]) -> Table:
    rows = tuple(
        (
            f"gyro {each.model.axis}",
            number(each.smoother.q / DEG**2),
            number(each.smoother.r / DEG**2),
            number(each.smoother.gain),
            number(each.smoother.time_constant),
            number(each.smoother.lag),
        )
        for each in gyros
    )
    columns = ("filter", "Q [(deg/s)²]", "R [(deg/s)²]", "settled gain", "time constant [s]", "lag of a ramp [s]")
    return Table("Scalar Kalman filter", columns, rows, f"P0 {P0 / DEG**2:g} (deg/s)², F = H = 1")


def _curves(each: GyroDrift) -> Table:
    rows = []
    for k, tau in enumerate(each.measured.allan.tau):
        cells = []
        for curve in (each.measured, each.corrected, each.smoothed):
            low, value, high = (float(x[k]) / DEG_PER_H for x in (curve.low, curve.deviation, curve.high))
            cells += [number(value), f"{number(low)} .. {number(high)}"]
        degrees = (number(float(curve.freedom[k]), 2) for curve in (each.corrected, each.smoothed))
        rows.append((f"{tau:g}", *cells, " / ".join(degrees)))
    columns = ("tau [s]", "before", "95 %", "corrected", "95 %", "smoothed", "95 %", "freedom corr. / smoothed")
    longest = each.corrected.allan
    note = (
        f"before: as measured; corrected: drift model taken off; smoothed: that after the filter. "
        f"{longest.tau[-1]:g} s out of {longest.n * longest.interval:g} s have "
        f"{number(float(each.corrected.freedom[-1]), 2)} equivalent degrees of freedom"
    )
    return Table(f"Allan deviation of gyro {each.model.axis} at rest [deg/h]", columns, tuple(rows), note)


def _coefficients(gyros: Sequence[GyroDrift]) -> Table:
    rows = []
    for each in gyros:
        for name in POWERS if each.corrected.coefficients else ():
            cells = []
            for curve in (each.measured, each.corrected, each.smoothed):
                found, factor = curve.coefficients[name], GYRO_UNITS[name].factor
                cells.append(number(found.value / factor) if found.value > 0.0 else "–")
                cells.append(_interval(found.low / factor, found.high / factor))
            rows.append((f"gyro {each.model.axis} {name}", *cells, GYRO_UNITS[name].unit))
    columns = ("coefficient", "before", "95 %", "corrected", "95 %", "smoothed", "95 %", "unit")
    note = "An interval from 0: not told from none. Intervals allow for what the sum misses of the curve; drift that "
    note += "follows something and a smoothed gyro are no sums of these noises, look at the deviations"
    return Table("Coefficients of sigma²(tau) = sum of A_m tau^m", columns, tuple(rows), note)


def _interval(low: float, high: float) -> str:
    if not high > 0.0:
        return "none"
    return f"{number(low) if low > 0.0 else '0'} .. {number(high)}"


def _ramps(gyros: Sequence[GyroDrift]) -> Table:
    rows = []
    for each in gyros:
        for answer in (each.computed, each.recorded):
            if answer is not None:
                kind = "of the record" if answer.measured else "0 to 10 r/min in 100 s, computed"
                rows.append((f"gyro {each.model.axis}, {kind}", *_ramp_cells(answer, each.smoother.lag)))
    columns = ("ramp", "slope [deg/s²]", "lag [s]", "1 sd [s]", "by the gain [s]", "largest error [deg/s]")
    return Table("Rate ramp", columns, tuple(rows), "lag and error in the second half of the ramp, error also after it")


def _ramp_cells(answer: RampAnswer, expected: float) -> tuple[str, ...]:
    return (
        number(answer.slope / DEG),
        number(answer.lag),
        number(answer.lag_sd, 2) if answer.measured else "–",
        number(expected),
        number(answer.worst / DEG),
    )


def _times(time: np.ndarray[Any, Any]) -> list[str]:
    return [f"{each:g} s" for each in time]


def _facts(found: DriftStudy, table: BenchTable, fits: dict[str, Any], warnings: Sequence[str]) -> dict[str, Any]:
    gyros = {}
    for each in found.gyros:
        gyros[f"gyro_{each.model.axis}"] = {
            "drift": {
                term: {
                    "value": value / _TERMS[term][2],
                    "sd": each.model.sd[term] / _TERMS[term][2],
                    "unit": _TERMS[term][1],
                }
                for term, value in each.model.value.items()
            },
            "left_out": dict(each.model.left_out),
            "filter": {
                "q_deg2_s2": each.smoother.q / DEG**2,
                "r_deg2_s2": each.smoother.r / DEG**2,
                "p0_deg2_s2": P0 / DEG**2,
                "gain": each.smoother.gain,
                "time_constant_s": each.smoother.time_constant,
                "lag_s": each.smoother.lag,
                "smallest_q": each.smoother.bounded,
            },
            "tau_s": each.corrected.allan.tau.tolist(),
            "before": _curve_facts(each.measured),
            "corrected": _curve_facts(each.corrected),
            "smoothed": _curve_facts(each.smoothed),
            "ramp_computed": _ramp_facts(each.computed),
            "ramp_recorded": None if each.recorded is None else _ramp_facts(each.recorded),
        }
    facts: dict[str, Any] = json_ready(
        {
            "command": "drift",
            "input": {"path": table.name, "sha256": table.sha256, "units": dict(table.units)},
            "gyros": gyros,
            "fits": fit_facts(fits, "rad/s"),
            "notes": list(found.notes),
            "warnings": list(warnings),
            "assumptions": list(ASSUMPTIONS),
        }
    )
    return facts


def _curve_facts(curve: Curve) -> dict[str, Any]:
    return {
        "deviation_deg_h": (curve.deviation / DEG_PER_H).tolist(),
        "low_deg_h": (curve.low / DEG_PER_H).tolist(),
        "high_deg_h": (curve.high / DEG_PER_H).tolist(),
        "degrees_of_freedom": curve.freedom.tolist(),
        "coefficients": {
            GYRO_UNITS[name].key: {
                "value": each.value / GYRO_UNITS[name].factor,
                "low": each.low / GYRO_UNITS[name].factor,
                "high": each.high / GYRO_UNITS[name].factor,
            }
            for name, each in curve.coefficients.items()
        },
    }


def _ramp_facts(answer: RampAnswer) -> dict[str, float]:
    return {
        "slope_deg_s2": answer.slope / DEG,
        "lag_s": answer.lag,
        "lag_sd_s": answer.lag_sd,
        "largest_error_deg_s": answer.worst / DEG,
    }


def rates_csv(found: DriftStudy) -> str:
    """Write the corrected and the smoothed rates as text of a table.

    Parameters
    ----------
    found : DriftStudy
    """
    columns = [("time_s", found.record.time)]
    for each in found.gyros:
        columns += [
            (f"gyro_{each.model.axis}_corrected_deg_s", each.corrected_rate / DEG),
            (f"gyro_{each.model.axis}_smoothed_deg_s", each.smoothed_rate / DEG),
        ]
    lines = [",".join(name for name, _ in columns)]
    rows = np.column_stack([values for _, values in columns])
    return "\n".join([*lines, *(",".join(f"{value:.10g}" for value in row) for row in rows)]) + "\n"
