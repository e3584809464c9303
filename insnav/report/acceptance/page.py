"""Acceptance figures as one page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from insnav.lab.acceptance.acceptance import Acceptance, Accepted
from insnav.lab.acceptance.figures_of_merit import BENCH_UNIT, Spread, Stability
from insnav.lab.bench_data.records import SI, BenchRecord
from insnav.lab.least_squares import Fit
from insnav.report.acceptance.figures import draw_stability
from insnav.report.calibration.figures import Series, draw_residuals
from insnav.report.calibration.page import condition_warnings, fit_facts, quality_table
from insnav.report.numbers import number, rounded
from insnav.report.page import Table
from insnav.report.run_json import json_ready
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.units import DEG, DEG_PER_H, G0, UG

FINE = 0.01 * DEG  # gyros whose biases are all below are shown in deg/h [rad/s]
_FACT_UNITS = {"gyro": ("deg_s", DEG), "accel": ("ug", UG)}
ASSUMPTIONS = (
    "output = U0 + K setting by least squares; forward: settings from zero up, reverse: from zero down; the mean of "
    "both counts where both are there; bias = U0 / K",
    "bias stability: standard deviation (n - 1) of the means of equal parts of the record at rest, over K",
    "bias repeatability: standard deviation (n - 1) of the biases of the power-ups, each (mean at +w + mean at -w) / "
    "2, over K",
    "intervals 95 %, chi-square with n - 1 degrees of freedom: means of neighbouring parts taken as independent, which "
    "those of a drifting sensor are not",
    "the bias of a gyro has the part of the Earth's rotation along its axis in it, at most 0.0042 deg/s (15 deg/h); "
    "the bias of a power-up has it as well, its scatter has not",
)


def acceptance_report(found: Acceptance, files: Sequence[BenchRecord]) -> tuple[Sheet, dict[str, Any]]:
    """Report on the acceptance figures.

    Parameters
    ----------
    found : Acceptance
    files : sequence of BenchRecord
        The input.

    Returns
    -------
    Sheet, dict
        The page, and the facts for ``run.json``.
    """
    tables: list[Table] = []
    fits: dict[str, Fit] = {}
    for sensor, title in (("gyro", "Gyros"), ("accel", "Accelerometers")):
        mine = [item for item in found.sensors if item.axis.startswith(sensor)]
        if mine:
            tables.append(_figures(title, sensor, mine))
        measured = [item for item in mine if item.scale is not None]
        lines = {item.axis: item.scale.table.fit for item in measured if item.scale is not None}
        fits |= lines
        for item in measured:
            assert item.scale is not None
            unit, used = BENCH_UNIT[sensor][0], item.scale.table
            settings = {item.axis: [f"{value:+g} {unit}" for value in used.rate[used.used]]}
            tables.append(quality_table({item.axis: used.fit}, _output_unit(item), settings))
    tables = _one_quality(tables)
    left_out = [
        f"{item.axis} leaves out {drop.rate:+g} {BENCH_UNIT[item.axis.split()[0]][0]}: {drop.reason}"
        for item in found.sensors
        if item.scale is not None
        for drop in item.scale.table.dropped
    ]
    warnings = (*found.warnings, *condition_warnings(fits))
    at_rest = f", {found.length:.6g} s at rest" if found.length else ""
    names = ", ".join(item.axis for item in found.sensors)
    sheet = Sheet(
        "Acceptance of gyros and accelerometers",
        (f"{names}{at_rest}; {', '.join(record.table.name for record in files)}", *left_out),
        tuple(tables),
        tuple(_pictures(found)),
        (*ASSUMPTIONS, *found.notes),
        warnings,
    )
    return sheet, _facts(found, files, left_out, warnings)


def _output_unit(item: Accepted) -> str:
    return BENCH_UNIT[item.axis.split()[0]][0] if item.unit in SI.values() else item.unit


def _one_quality(tables: list[Table]) -> list[Table]:
    """Tables of residuals with the same headings as one."""
    merged: dict[tuple[str, ...], Table] = {}
    for table in tables:
        before = merged.get(table.columns)
        rows = table.rows if before is None else (*before.rows, *table.rows)
        merged[table.columns] = Table(table.title, table.columns, rows, table.note)
    return list(merged.values())


def _figures(title: str, sensor: str, items: Sequence[Accepted]) -> Table:
    unit, factor = _unit(sensor, items)
    columns = [_column(item, unit, factor) for item in items]
    names = max(columns, key=len) | {name: "" for column in columns for name in column}
    rows = tuple((name, *(column.get(name, "–") for column in columns)) for name in names)
    return Table(title, ("figure", *(item.axis for item in items)), rows, "± 1 sd; in brackets the 95 % interval")


def _column(item: Accepted, unit: str, factor: float) -> dict[str, str]:
    """Figures of one sensor by their names, in the order of the page."""
    cells: dict[str, str] = {}
    if item.scale is not None:
        table = item.scale.table
        bench = BENCH_UNIT[item.axis.split()[0]][1] / factor
        senses = {"forward": table.forward, "reverse": table.reverse} if table.average is not None else {}
        known = {sense: fit for sense, fit in senses.items() if fit is not None}
        cells["scale factor K"] = _with_sd(item.scale.k, item.scale.k_sd)
        for sense, fit in known.items():
            cells[f"  K {sense}"] = _with_sd(fit.value[1], fit.sd[1])
        if table.asymmetry is not None:
            cells["  asymmetry [ppm]"] = number(table.asymmetry * 1e6)
        cells["  unit of K"] = _k_unit(item)
        cells[f"bias [{unit}]"] = _with_sd(item.scale.bias / factor, item.scale.bias_sd / factor)
        for sense, fit in known.items():
            zero, sd = fit.value[0] / fit.value[1] * bench, fit.sd[0] / abs(fit.value[1]) * bench
            cells[f"  bias {sense} [{unit}]"] = _with_sd(zero, sd)
    for each in item.stability:
        cells[f"bias stability, {each.length:g} s [{unit}]"] = _shown(each.spread, factor)
        cells[f"  parts of {each.length:g} s"] = str(each.spread.values.size)
    if item.repeatability is not None:
        cells[f"bias repeatability [{unit}]"] = _shown(item.repeatability, factor)
        cells["  power-ups"] = str(item.repeatability.values.size)
        cells[f"  their mean bias [{unit}]"] = number(float(item.repeatability.values.mean()) / factor)
    return cells


def _unit(sensor: str, items: Sequence[Accepted]) -> tuple[str, float]:
    if sensor == "accel":
        return ("ug", UG) if _largest(items) < 0.01 * G0 else ("mg", 1e-3 * G0)
    return ("deg/h", DEG_PER_H) if _largest(items) < FINE else ("deg/s", DEG)


def _largest(items: Sequence[Accepted]) -> float:
    biases = [abs(item.scale.bias) for item in items if item.scale is not None]
    spreads = [item.repeatability for item in items if item.repeatability is not None]
    spreads += [each.spread for item in items for each in item.stability]
    return max([*biases, *(each.sd for each in spreads)], default=0.0)


def _with_sd(value: float, sd: float) -> str:
    return f"{rounded(value, sd)} ± {number(sd, 2)}"


def _k_unit(item: Accepted) -> str:
    return "1" if item.unit in SI.values() else f"{item.unit}/({BENCH_UNIT[item.axis.split()[0]][0]})"


def _shown(spread: Spread, factor: float) -> str:
    return f"{number(spread.sd / factor)} ({number(spread.low / factor)} .. {number(spread.high / factor)})"


def _pictures(found: Acceptance) -> list[Picture]:
    pictures = []
    with drawing():
        for sensor, title in (("gyro", "gyros"), ("accel", "accelerometers")):
            unit = BENCH_UNIT[sensor][0]
            series = [
                Series(
                    f"{item.axis} residual [{_output_unit(item)}]",
                    item.scale.table.rate,
                    item.scale.table.output
                    - item.scale.table.fit.value[0]
                    - item.scale.table.fit.value[1] * item.scale.table.rate,
                    item.scale.table.used,
                    item.scale.table.fit.sigma,
                )
                for item in found.sensors
                if item.scale is not None and item.axis.startswith(sensor)
            ]
            if series:
                label = f"{'rate' if sensor == 'gyro' else 'specific force'} set [{unit}]"
                figure = draw_residuals(series, label, f"Acceptance: output of the {title} minus the straight line")
                pictures.append(Picture(f"residuals_{sensor}", figure, "Residuals of the straight lines."))
        at_rest = [item for item in found.sensors if item.stability]
        if at_rest:
            figure = draw_stability([(item.axis, item.stability, _rest_unit(item)) for item in at_rest])
            pictures.append(Picture("stability", figure, "Means of the parts of the record at rest."))
    return pictures


def _rest_unit(item: Accepted) -> tuple[str, float]:
    return _unit(item.axis.split()[0], [item])


def _facts(
    found: Acceptance, files: Sequence[BenchRecord], left_out: Sequence[str], warnings: Sequence[str]
) -> dict[str, Any]:
    sensors = {}
    for item in found.sensors:
        suffix, factor = _FACT_UNITS[item.axis.split()[0]]
        facts: dict[str, Any] = {"output_unit": _output_unit(item)}
        if item.scale is not None:
            table = item.scale.table
            facts |= {
                "scale_factor": {"value": item.scale.k, "sd": item.scale.k_sd, "unit": _k_unit(item)},
                "scale_factor_forward": None if table.forward is None else float(table.forward.value[1]),
                "scale_factor_reverse": None if table.reverse is None else float(table.reverse.value[1]),
                f"bias_{suffix}": {"value": item.scale.bias / factor, "sd": item.scale.bias_sd / factor},
                "fit": fit_facts({item.axis: table.fit}, _output_unit(item))[0],
            }
        if item.stability:
            facts[f"bias_stability_{suffix}"] = [_stability_facts(each, factor) for each in item.stability]
        if item.repeatability is not None:
            facts[f"bias_repeatability_{suffix}"] = _spread_facts(item.repeatability, factor)
            facts[f"powerup_biases_{suffix}"] = np.asarray(item.repeatability.values / factor).tolist()
        sensors[item.axis.replace(" ", "_")] = facts
    result: dict[str, Any] = json_ready(
        {
            "command": "acceptance",
            "input": [{"path": r.table.name, "sha256": r.table.sha256, "units": dict(r.table.units)} for r in files],
            "sensors": sensors,
            "left_out": list(left_out),
            "notes": list(found.notes),
            "warnings": list(warnings),
            "assumptions": list(ASSUMPTIONS),
        }
    )
    return result


def _stability_facts(each: Stability, factor: float) -> dict[str, float]:
    return {"length_s": each.length, **_spread_facts(each.spread, factor)}


def _spread_facts(spread: Spread, factor: float) -> dict[str, float]:
    return {
        "sd": spread.sd / factor,
        "variance": spread.variance / factor**2,
        "low": spread.low / factor,
        "high": spread.high / factor,
        "n": spread.values.size,
    }
