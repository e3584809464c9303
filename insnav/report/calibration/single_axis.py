"""Reports of the rate table and of the tumble test."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from insnav.lab.calibration import Calibration
from insnav.lab.single_axis.rate_table import RateTable
from insnav.lab.single_axis.records import Record
from insnav.lab.single_axis.tumble import Tumble
from insnav.quantity import Quantity
from insnav.report.calibration.figures import Series, draw_residuals
from insnav.report.calibration.page import base_facts, fit_facts, impact_table, parameter_table, quality_table
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.units import DEG


def gyro_report(
    calibration: Calibration[tuple[Record, ...], tuple[RateTable, ...]],
) -> tuple[Sheet, dict[str, Any]]:
    """Page and facts of gyros on a rate table."""
    records, found, items, fits = calibration.record, calibration.detail, calibration.parameters, calibration.fits
    names, unit = tuple(fits), records[0].unit
    units = (unit, f"{unit}/(deg/s)")
    settings = {
        name: [f"{rate:+g} deg/s" for rate in item.rate[item.used]] for name, item in zip(names, found, strict=True)
    }
    dropped = [(name, drop) for name, item in zip(names, found, strict=True) for drop in item.dropped]
    lines = [
        f"{name} leaves out {drop.rate:+g} deg/s: {drop.reason}; residual {number(drop.residual)} {unit}, "
        f"chance explains up to {number(drop.limit, 2)} {unit}"
        for name, drop in dropped
    ]
    tables = [
        parameter_table("Output = U0 + K rate", items),
        *_senses(names, found, units),
        quality_table(fits, unit, settings),
        *_dwells(records, names),
        impact_table(calibration),
    ]
    with drawing():
        series = [
            Series(
                f"{name} residual [{unit}]",
                item.rate,
                item.output - (item.fit.value[0] + item.fit.value[1] * item.rate),
                item.used,
                item.fit.sigma,
            )
            for name, item in zip(names, found, strict=True)
        ]
        figure = draw_residuals(
            series, "rate [deg/s]", "Rate table: output minus the straight line", _dropped_note(lines)
        )
    facts = base_facts("gyro rate table", [r.table for r in records], calibration)
    facts["fits"] = fit_facts(fits, unit)
    facts["dropped"] = [
        {"sensor": n, "rate_deg_s": d.rate, "residual": d.residual, "limit": d.limit, "reason": d.reason}
        for n, d in dropped
    ]
    return (
        Sheet(
            "Gyros on a rate table",
            (*_summary(items), *lines),
            tuple(tables),
            (Picture("residuals", figure, "Residuals of the fit; crosses were left out."),),
            (
                "The rate of the table is exact, and the component of the Earth's rotation along the axis is in U0.",
                "Forward are rates from zero up, reverse from zero down.",
            ),
            calibration.warnings,
        ),
        facts,
    )


def accel_report(
    calibration: Calibration[tuple[Record, ...], tuple[Tumble, ...]],
) -> tuple[Sheet, dict[str, Any]]:
    """Page and facts of accelerometers tumbled in gravity."""
    records, found, items, fits = calibration.record, calibration.detail, calibration.parameters, calibration.fits
    gravity = calibration.options.gravity
    names, unit = tuple(fits), records[0].unit
    settings = {
        name: [f"{angle / DEG:.4g} deg" for angle in item.angle] for name, item in zip(names, found, strict=True)
    }
    with drawing():
        series = [
            Series(
                f"{name} residual [{unit}]",
                item.angle / DEG,
                item.fit.residual,
                np.ones(item.angle.size, dtype=np.bool_),
                item.fit.sigma,
            )
            for name, item in zip(names, found, strict=True)
        ]
        figure = draw_residuals(series, "angle of the input axis [deg]", "Tumble test: output minus the model")
    facts = base_facts("accelerometer tumble", [r.table for r in records], calibration)
    facts |= {"fits": fit_facts(fits, unit), "gravity_m_s2": gravity}
    sheet = Sheet(
        "Accelerometers tumbled in gravity",
        _summary(items),
        (
            parameter_table("Output = K0 + K1 ai + K2 ai² + K3 ai ao", items, "ai = sin, ao = cos of the angle, in g"),
            quality_table(fits, unit, settings),
            *_dwells(records, names),
            impact_table(calibration),
        ),
        (Picture("residuals", figure, "Residuals of the fit."),),
        (
            f"Gravity is {gravity:.6g} m/s²; the angles are exact.",
            "The calibration file holds bias and scale factor; second order and cross-coupling are reported only.",
        ),
        calibration.warnings,
    )
    return sheet, facts


def _summary(items: Sequence[Quantity]) -> tuple[str, ...]:
    return tuple(f"{p.label} {_short(p.scaled(p.value))} ± {number(p.scaled(p.sd), 2)} {p.shown_unit}" for p in items)


def _short(value: float) -> str:
    """Four digits, and four decimals as such calibrations are published."""
    size = abs(value)
    return number(value, 4) if size < 0.1 or size >= 1000.0 else f"{value:.4f}"


def _dropped_note(lines: Sequence[str]) -> str:
    return (
        f"{len(lines)} left out, for the reasons in the report; far from zero the scale is logarithmic" if lines else ""
    )


def _senses(names: Sequence[str], found: Sequence[RateTable], units: Sequence[str]) -> list[Table]:
    """Forward, reverse and their average, where both senses of rotation were measured."""
    rows = []
    for name, item in zip(names, found, strict=True):
        if item.average is None or item.forward is None or item.reverse is None or item.asymmetry is None:
            continue
        value, sd = item.average
        for sense, numbers, sds in (
            ("forward", item.forward.value, item.forward.sd),
            ("reverse", item.reverse.value, item.reverse.sd),
            ("average", value, sd),
        ):
            cells = [f"{number(float(v), 4)} ± {number(float(s), 2)}" for v, s in zip(numbers, sds, strict=True)]
            asymmetry = f"{100.0 * item.asymmetry:.3g} %" if sense == "average" else ""
            rows.append((f"{name} {sense}", *cells, asymmetry))
    if not rows:
        return []
    columns = ("rotation", f"U0 [{units[0]}]", f"K [{units[1]}]", "K forward - reverse")
    return [Table("Both senses of rotation", columns, tuple(rows))]


def _dwells(records: Sequence[Record], names: Sequence[str]) -> list[Table]:
    """What cleaning dropped, where there were samples to clean."""
    rows = tuple(
        (
            name,
            str(record.dwells.count.size),
            f"{int(record.dwells.count.min())} to {int(record.dwells.count.max())}",
            str(int(record.dwells.dropped.sum())),
        )
        for name, record in zip(names, records, strict=True)
        if record.dwells.raw
    )
    columns = ("sensor", "dwells", "samples each", "spikes dropped")
    note = (
        "Each dwell: polynomial of order 7 through its samples, those beyond the spike limit dropped, mean of the rest."
    )
    return [Table("Raw dwells", columns, rows, note)] if rows else []
