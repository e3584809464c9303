"""The noise of a static record as a sheet, facts and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from insnav.lab.noise.allan import AXES
from insnav.lab.noise.noise_model import Coefficient, NoiseModel
from insnav.lab.noise.static_noise import StaticNoise
from insnav.report.noise.figures import draw_allan
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.run_json import json_ready
from insnav.report.sheet import Picture, Sheet
from insnav.report.style import drawing
from insnav.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, HOUR, M_S_PER_SQRT_H, UG

_TIMES = (0.01, 0.1, 1.0, 10.0, 100.0, 1000.0, 10000.0)  # of the table of deviations [s]
_NEAR = 1.3  # a table entry stands for times this near


@dataclass(frozen=True, slots=True)
class _Unit:
    key: str  # of the fact in field units
    unit: str
    factor: float
    si: str  # key of the fact in SI


GYRO_UNITS = {
    "Q": _Unit("quantisation_arcsec", "arcsec", DEG / 3600.0, "quantisation_rad"),
    "N": _Unit("random_walk_deg_sqrt_h", "deg/√h", DEG_PER_SQRT_H, "random_walk_rad_sqrt_s"),
    "B": _Unit("bias_instability_deg_h", "deg/h", DEG_PER_H, "bias_instability_rad_s"),
    "K": _Unit("rate_random_walk_deg_h_sqrt_h", "deg/h/√h", DEG_PER_H / np.sqrt(HOUR), "rate_random_walk_rad_s_sqrt_s"),
    "GM": _Unit("gauss_markov_deg_h", "deg/h", DEG_PER_H, "gauss_markov_rad_s"),
    "R": _Unit("rate_ramp_deg_h_h", "deg/h/h", DEG_PER_H / HOUR, "rate_ramp_rad_s2"),
}
ACCEL_UNITS = {
    "Q": _Unit("quantisation_mm_s", "mm/s", 1e-3, "quantisation_m_s"),
    "N": _Unit("random_walk_m_s_sqrt_h", "m/s/√h", M_S_PER_SQRT_H, "random_walk_m_s_sqrt_s"),
    "B": _Unit("bias_instability_ug", "ug", UG, "bias_instability_m_s2"),
    "K": _Unit("rate_random_walk_ug_sqrt_h", "ug/√h", UG / np.sqrt(HOUR), "rate_random_walk_m_s2_sqrt_s"),
    "GM": _Unit("gauss_markov_ug", "ug", UG, "gauss_markov_m_s2"),
    "R": _Unit("rate_ramp_ug_h", "ug/h", UG / HOUR, "rate_ramp_m_s3"),
}
_WORDS = {
    "Q": "quantisation Q",
    "N": "random walk N",
    "B": "bias instability B",
    "K": "rate random walk K",
    "GM": "Gauss-Markov bias, sd",
    "R": "rate ramp R",
}
ASSUMPTIONS = (
    "overlapping Allan deviation, NIST SP 1065 (2008) section 5.2.5; noise terms of IEEE Std 952-1997 annex C",
    "intervals 95 %: chi-square with the degrees of freedom that the fitted noise gives a record of this length "
    "(Greenhall and Riley 2003)",
    "fit by generalised least squares with the correlation between averaging times that the noise itself makes, up to "
    "a sixth of the record; no term is negative, and one that lowers chi-square by less than 6.63 (1 %) is left out",
    "bias instability is B (a flat floor, 0.664 B) or a Gauss-Markov process, whichever is likelier",
)


def _units(column: int) -> Mapping[str, _Unit]:
    return GYRO_UNITS if column < 3 else ACCEL_UNITS


def noise_sheet(found: StaticNoise, name: str) -> Sheet:
    """Make the sheet of a noise analysis.

    Parameters
    ----------
    found : StaticNoise
    name : str
        Of the record.
    """
    record = found.record
    with drawing():
        figure = draw_allan(found.allan, found.models, f"Allan deviation of {name}")
    return Sheet(
        f"Noise of {name}",
        (
            f"{record.length:.6g} s at {1.0 / record.interval:.6g} Hz, {len(found.allan.tau)} averaging times from "
            f"{found.allan.tau[0]:.3g} to {found.allan.tau[-1]:.4g} s",
        ),
        (_coefficients(found), _deviations(found), _filter_figures(found)),
        (Picture("allan", figure, "Overlapping Allan deviation, fitted models and 95 % intervals"),),
        (*ASSUMPTIONS, *found.notes),
        found.warnings,
    )


def _coefficients(found: StaticNoise) -> Table:
    rows = []
    for column, model in enumerate(found.models):
        if model is None:
            continue
        for name, each in model.coefficients.items():
            unit = _units(column)[name]
            value, sd, low, high = (x / unit.factor for x in (each.value, each.sd, each.low, each.high))
            rows.append(
                (
                    AXES[column],
                    _WORDS[name],
                    number(value),
                    number(sd, 2),
                    f"{number(low)} .. {number(high)}",
                    unit.unit,
                )
            )
        if np.isfinite(model.correlation_time):
            sd = model.correlation_time_sd
            rows.append((AXES[column], "its correlation time", number(model.correlation_time), number(sd, 2), "", "s"))
    return Table(
        "Noise coefficients",
        ("axis", "term", "value", "1 sd", "95 %", "unit"),
        tuple(rows),
        "only terms that the data support; 1 m/s/√h of an accelerometer is "
        f"{M_S_PER_SQRT_H / UG:.0f} ug/√Hz, 1 deg/√h is 60 deg/h/√Hz",
    )


def _deviations(found: StaticNoise) -> Table:
    tau = found.allan.tau
    rows = []
    for wanted in _TIMES:
        row = int(np.argmin(np.abs(np.log(tau / wanted))))
        if not 1.0 / _NEAR < tau[row] / wanted < _NEAR:
            continue
        cells = [number(float(tau[row]))]
        cells += [number(float(found.allan.deviation[row, i]) / _units(i)["B"].factor) for i in range(6)]
        cells.append(number(min((float(m.freedom[row]) for m in found.models if m is not None), default=None), 2))
        rows.append(tuple(cells))
    cells = ["floor"]
    cells += [number(None if f is None else f.value / _units(i)["B"].factor) for i, f in enumerate(found.floors)]
    rows.append((*cells, ""))
    where = ", ".join(f"{AXES[i]} {f.tau:.3g}" for i, f in enumerate(found.floors) if f is not None)
    return Table(
        "Allan deviation",
        ("tau [s]", *(f"{axis} [{_units(i)['B'].unit}]" for i, axis in enumerate(AXES)), "degrees of freedom"),
        tuple(rows),
        f"floor: lowest deviation with ten degrees of freedom, at tau [s] {where}" if where else "no axis shows noise",
    )


def _filter_figures(found: StaticNoise) -> Table:
    rows = []
    for first, sensor, units in ((0, found.spec.gyro, GYRO_UNITS), (3, found.spec.accel, ACCEL_UNITS)):
        for axis in range(3):
            cells = [
                number(float(value[axis]) / units[term].factor or None)
                for term, value in (
                    ("N", sensor.random_walk),
                    ("B", sensor.bias_instability),
                    ("K", sensor.rate_random_walk),
                    ("Q", sensor.quantisation),
                    ("R", sensor.rate_ramp),
                )
            ]
            time = sensor.correlation_time if np.isfinite(sensor.correlation_time) else None
            named = ", ".join(units[term].unit for term in "NBKQR")
            rows.append((AXES[first + axis], cells[0], cells[1], number(time), *cells[2:], named))
    columns = (
        "random walk",
        "bias instability, sd",
        "correlation time [s]",
        "rate random walk",
        "quantisation",
        "ramp",
    )
    return Table(
        "Figures for filters and simulations (imu.toml)",
        ("axis", *columns, "units"),
        tuple(rows),
        "bias instability as the standard deviation of a Gauss-Markov process; quantisation and rate ramp are only "
        "simulated; use with insnav run --imu imu.toml",
    )


def noise_facts(found: StaticNoise, reading: Mapping[str, Any]) -> dict[str, Any]:
    """Gather the results, JSON-ready, units in the keys.

    Parameters
    ----------
    found : StaticNoise
    reading : mapping
        What was read.
    """
    axes = {}
    for column, (axis, model) in enumerate(zip(AXES, found.models, strict=True)):
        axes[axis.replace(" ", "_")] = None if model is None else _axis_facts(found, column, model)
    facts: dict[str, Any] = json_ready(
        {
            "command": "allan",
            "imu": dict(reading),
            "length_s": found.record.length,
            "interval_s": found.record.interval,
            "axes": axes,
            "notes": list(found.notes),
            "warnings": list(found.warnings),
            "assumptions": list(ASSUMPTIONS),
        }
    )
    return facts


def _axis_facts(found: StaticNoise, column: int, model: NoiseModel) -> dict[str, Any]:
    units, floor = _units(column), found.floors[column]
    facts: dict[str, Any] = {}
    for name, each in model.coefficients.items():
        unit = units[name]
        facts[unit.key] = _figures(each, unit.factor)
        facts[unit.si] = each.value
    if np.isfinite(model.correlation_time):
        facts["correlation_time_s"] = {"value": model.correlation_time, "sd": model.correlation_time_sd}
    assert floor is not None
    key = units["B"].key.replace("bias_instability", "floor")
    return facts | {key: floor.value / units["B"].factor, "floor_tau_s": floor.tau, "misfit": model.misfit}


def _figures(each: Coefficient, factor: float) -> dict[str, float]:
    return {
        "value": each.value / factor,
        "sd": each.sd / factor,
        "low": each.low / factor,
        "high": each.high / factor,
    }


def deviations_csv(found: StaticNoise) -> str:
    """Write the deviations with their intervals as text of a table, one row for each averaging time.

    Parameters
    ----------
    found : StaticNoise
    """
    columns = [("tau_s", found.allan.tau)]
    for i, (axis, model) in enumerate(zip(AXES, found.models, strict=True)):
        unit = "deg_h" if i < 3 else "ug"
        name, factor = axis.replace(" ", "_"), _units(i)["B"].factor
        columns.append((f"{name}_{unit}", found.allan.deviation[:, i] / factor))
        if model is not None:
            columns += [
                (f"{name}_low_{unit}", model.low / factor),
                (f"{name}_high_{unit}", model.high / factor),
                (f"{name}_model_{unit}", np.sqrt(model.variance) / factor),
                (f"{name}_freedom", model.freedom),
            ]
    rows = np.column_stack([values for _, values in columns])
    lines = [",".join(name for name, _ in columns)]
    return "\n".join([*lines, *(",".join(f"{value:.9g}" for value in row) for row in rows)]) + "\n"
