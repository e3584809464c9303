"""Reports of the rate table and of the tumble test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from insnav.lab.least_squares import Fit
from insnav.lab.navigation_impact import Calibrated, Effect
from insnav.lab.single_axis.method import Record, rate_table_warnings, tumble_warnings
from insnav.lab.single_axis.rate_table import RateTable
from insnav.lab.single_axis.tumble import Tumble
from insnav.report.calibration.figures import Series, draw_residuals
from insnav.report.calibration.page import (
    base_facts,
    condition_warnings,
    effect_table,
    fit_facts,
    parameter_table,
    parameters,
    quality_table,
    without_words,
)
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.units import DEG

_ONE_FOR_ALL = "one sensor was measured; the calibration file uses its values for x, y and z"


def gyro_report(
    records: Sequence[Record], found: Sequence[RateTable], calibrated: Calibrated, effects: Sequence[Effect]
) -> tuple[Sheet, dict[str, Any]]:
    """Report on gyros on a rate table.

    Parameters
    ----------
    records : sequence of Record
        One or three.
    found : sequence of RateTable
        Of the same.
    calibrated : Calibrated
        What is written.
    effects : sequence of Effect
        What it is worth.

    Returns
    -------
    Sheet, dict
        The page, and the facts for ``run.json``.
    """
    names, unit = _names(len(records)), records[0].unit
    units = (unit, f"{unit}/(deg/s)")
    fits = dict(zip(names, (item.fit for item in found), strict=True))
    items = [p for name, fit in fits.items() for p in parameters(fit, units, name)]
    settings = {
        name: [f"{rate:+g} deg/s" for rate in item.rate[item.used]] for name, item in zip(names, found, strict=True)
    }
    warnings = _common_warnings(records, names, fits)
    warnings += tuple(
        f"{name}: {line}" for name, item in zip(names, found, strict=True) for line in rate_table_warnings(item)
    )
    if len(records) == 1:
        warnings += (_ONE_FOR_ALL,)
    dropped = [(name, drop) for name, item in zip(names, found, strict=True) for drop in item.dropped]
    lines = [
        f"{name} leaves out {drop.rate:+g} deg/s: {drop.reason}; residual {number(drop.residual)} {unit}, "
        f"chance explains up to {number(drop.limit, 2)} {unit}"
        for name, drop in dropped
    ]
    summary = [f"{p.name} {_short(p.value)} ± {number(p.sd, 2)} {p.unit}" for p in items]
    tables = [
        parameter_table("Output = U0 + K rate", items),
        *_senses(names, found, units),
        quality_table(fits, unit, settings),
        *_dwells(records, names),
        effect_table(effects, without_words(calibrated.errors)),
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
    facts = base_facts("gyro rate table", [r.table for r in records], items, effects, warnings)
    facts["fits"] = fit_facts(fits, unit)
    facts["dropped"] = [
        {"sensor": n, "rate_deg_s": d.rate, "residual": d.residual, "limit": d.limit, "reason": d.reason}
        for n, d in dropped
    ]
    return (
        Sheet(
            "Gyros on a rate table",
            (*summary, *lines),
            tuple(tables),
            (Picture("residuals", figure, "Residuals of the fit; crosses were left out."),),
            (
                "The rate of the table is exact, and the component of the Earth's rotation along the axis is in U0.",
                "Forward are rates from zero up, reverse from zero down.",
            ),
            warnings,
        ),
        facts,
    )


def accel_report(
    records: Sequence[Record],
    found: Sequence[Tumble],
    calibrated: Calibrated,
    effects: Sequence[Effect],
    gravity: float,
) -> tuple[Sheet, dict[str, Any]]:
    """Report on accelerometers tumbled in gravity.

    Parameters
    ----------
    records : sequence of Record
        One or three.
    found : sequence of Tumble
        Of the same.
    calibrated : Calibrated
        What is written.
    effects : sequence of Effect
        What it is worth.
    gravity : float
        Local gravity [m/s^2].

    Returns
    -------
    Sheet, dict
        The page, and the facts for ``run.json``.
    """
    names, unit = _names(len(records)), records[0].unit
    units = (unit, f"{unit}/g", f"{unit}/g²", f"{unit}/g²")
    fits = dict(zip(names, (item.fit for item in found), strict=True))
    items = [p for name, fit in fits.items() for p in parameters(fit, units, name)]
    settings = {
        name: [f"{angle / DEG:.4g} deg" for angle in item.angle] for name, item in zip(names, found, strict=True)
    }
    warnings = _common_warnings(records, names, fits)
    warnings += tuple(
        f"{name}: {line}" for name, item in zip(names, found, strict=True) for line in tumble_warnings(item)
    )
    if len(records) == 1:
        warnings += (_ONE_FOR_ALL,)
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
    facts = base_facts("accelerometer tumble", [r.table for r in records], items, effects, warnings)
    facts |= {"fits": fit_facts(fits, unit), "gravity_m_s2": gravity}
    sheet = Sheet(
        "Accelerometers tumbled in gravity",
        tuple(f"{p.name} {_short(p.value)} ± {number(p.sd, 2)} {p.unit}" for p in items),
        (
            parameter_table("Output = K0 + K1 ai + K2 ai² + K3 ai ao", items, "ai = sin, ao = cos of the angle, in g"),
            quality_table(fits, unit, settings),
            *_dwells(records, names),
            effect_table(effects, without_words(calibrated.errors)),
        ),
        (Picture("residuals", figure, "Residuals of the fit."),),
        (
            f"Gravity is {gravity:.6g} m/s²; the angles are exact.",
            "The calibration file holds bias and scale factor; second order and cross-coupling are reported only.",
        ),
        warnings,
    )
    return sheet, facts


def _short(value: float) -> str:
    """Four digits, and four decimals as such calibrations are published."""
    size = abs(value)
    return number(value, 4) if size < 0.1 or size >= 1000.0 else f"{value:.4f}"


def _names(count: int) -> tuple[str, ...]:
    return ("x", "y", "z") if count == 3 else ("sensor",)


def _common_warnings(records: Sequence[Record], names: Sequence[str], fits: Mapping[str, Fit]) -> tuple[str, ...]:
    told = [f"{name}: {line}" for name, record in zip(names, records, strict=True) for line in record.warnings]
    return (*told, *condition_warnings(fits))


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
