"""Facts of the recorded half of an error budget, and the units of what windows err by."""

from __future__ import annotations

from typing import Any

from insnav.errors.budget.from_windows import RecordedBudget, RecordedPart
from insnav.errors.diagnosis.causes import CAUSES, AxisDiagnosis
from insnav.errors.diagnosis.equivalent_sensor_errors import SensorFit
from insnav.errors.diagnosis.simulated_replica import Replicas
from insnav.errors.outage.statistics import COMPONENTS, Growth
from insnav.report.run_json import json_ready
from insnav.types import FloatArray
from insnav.units import DEG_PER_H, G0

MG = 1e-3 * G0
UNITS = {"velocity": (1e-3, "mm/s"), "acceleration": (MG, "mg"), "drift": (DEG_PER_H, "deg/h")}
GROWS = {"velocity": "t", "acceleration": "t²", "drift": "t³"}


def recorded_facts(budget: RecordedBudget) -> dict[str, Any]:
    """Gather the figures, JSON-ready, units in the keys.

    Parameters
    ----------
    budget : RecordedBudget
    """
    facts: dict[str, Any] = {
        "judged_by": budget.reference,
        "start": budget.settings.start,
        "independent": budget.settings.start == "forward",
        "duration_s": budget.duration,
        "imu": budget.spec.name,
        "notes": list(budget.notes),
        "calibrated": _part_facts(budget.calibrated),
        "raw": None if budget.uncalibrated is None else _part_facts(budget.uncalibrated),
    }
    ready: dict[str, Any] = json_ready(facts)
    return ready


def _part_facts(part: RecordedPart) -> dict[str, Any]:
    windows = part.windows
    facts: dict[str, Any] = {
        "windows": windows.count,
        "length_s": windows.length,
        "spacing_s": windows.spacing,
        "dropped": windows.dropped,
        **_growth_facts(part.growth),
        "by_motion": {name: None if g is None else _growth_facts(g) for name, g in part.motions.items()},
        "verdicts": {
            each.component: {
                "rms_m": each.recorded,
                "interval_m": [each.low, each.high],
                "predicted_m": each.predicted,
                "explained": each.explained,
                "cautious": each.cautious,
            }
            for each in part.verdicts
        },
        "diagnosis": {
            "windows": part.diagnosis.windows.count,
            "set_aside": part.diagnosis.rough,
            "steady": part.diagnosis.steady,
            **{axis.axis: _axis_facts(axis) for axis in part.diagnosis.axes},
        },
        "sensors": _sensor_facts(part.sensors),
        "regression": {
            "slope": part.regression.slope,
            "interval": [part.regression.low, part.regression.high],
            "r_squared": part.regression.r_squared,
        },
        "twins": None if part.replicas is None else _twin_facts(part.replicas),
    }
    return facts


def _growth_facts(found: Growth) -> dict[str, Any]:
    def named(values: FloatArray) -> dict[str, FloatArray]:
        return {name: values[:, i] for i, name in enumerate(COMPONENTS)}

    return {
        "times_s": found.times,
        "count": found.count,
        "judged": found.known[:, found.column("horizontal")],
        "effective": found.effective,
        "rms_m": named(found.rms),
        "rms_low_m": named(found.low),
        "rms_high_m": named(found.high),
        "p95_m": named(found.p95),
        "max_m": named(found.largest),
        "judge_sd_m": named(found.reference),
        "predicted_m": named(found.predicted),
        "inside_3_sd": named(found.inside),
    }


def _axis_facts(axis: AxisDiagnosis) -> dict[str, Any]:
    out: dict[str, Any] = {"terms": axis.terms, "leading": GROWS[CAUSES[axis.leading]]}
    for name, cause in zip(CAUSES, axis.causes, strict=True):
        unit, text = UNITS[name]
        suffix = text.replace("/", "_")
        out[name] = {
            f"rms_{suffix}": cause.rms / unit,
            f"mean_{suffix}": cause.mean / unit,
            f"mean_sd_{suffix}": cause.mean_sd / unit,
            f"fit_sd_{suffix}": cause.fit_sd / unit,
            f"filter_sd_{suffix}": cause.filter_sd / unit,
            f"specified_{suffix}": cause.spec_sd / unit,
            "share": cause.share,
            "explained": cause.explained,
        }
    return out


def _sensor_facts(fit: SensorFit) -> dict[str, Any]:
    return {
        "accel_bias_mg": fit.accel / MG,
        "accel_bias_sd_mg": fit.accel_sd / MG,
        "gyro_bias_deg_h": fit.gyro / DEG_PER_H,
        "gyro_bias_sd_deg_h": fit.gyro_sd / DEG_PER_H,
        "misfit": fit.spread,
        "bias_told_from_tilt": fit.level_observable,
    }


def _twin_facts(made: Replicas) -> dict[str, Any]:
    return {
        "count": len(made.rms),
        "inside_band": made.agree,
        "low_m": {name: made.low[:, i] for i, name in enumerate(COMPONENTS)},
        "high_m": {name: made.high[:, i] for i, name in enumerate(COMPONENTS)},
        "recorded_m": {name: made.recorded[:, i] for i, name in enumerate(COMPONENTS)},
        "track_apart_m": made.apart.position,
        "track_apart_m_s": made.apart.velocity,
        "failures": list(made.failures),
    }
