"""Everything worth knowing about a run as one nested dict, ready for JSON.

The unit is in every key; what is not known is None. Nothing depends on the clock or the machine, so the same
input gives the same facts.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from insnav.errors.gps_gaps import outages
from insnav.errors.metrics import MOVING_M_S, TrajectoryErrors, accuracy_by_motion, distance_and_time, nees
from insnav.report.run_json import json_ready, versions
from insnav.types import Alignment, BoolArray, EventKind, FloatArray, Run, SensorErrors, Trajectory
from insnav.units import DEG, DEG_PER_H, G0, PPM

_REASONS = {
    EventKind.GATE_QUALITY: "quality",
    EventKind.GATE_PHYSICAL_POSITION: "physical limit, position",
    EventKind.GATE_PHYSICAL_VELOCITY: "physical limit, velocity",
    EventKind.GATE_POSITION: "chi-square, position",
    EventKind.GATE_VELOCITY: "chi-square, velocity",
}


def run_facts(
    run: Run,
    *,
    reading: Mapping[str, Mapping[str, Any]],
    configuration: Mapping[str, Any],
    imu_model: Mapping[str, Any] | None = None,
    errors: TrajectoryErrors | None = None,
    smoothed_errors: TrajectoryErrors | None = None,
    reference_name: str = "",
    warnings: Sequence[str] = (),
) -> dict[str, Any]:
    """Gather the facts of a run.

    Parameters
    ----------
    run : Run
    reading : mapping
        For each input (``imu``, ``gps``, ``reference``) what was understood of it: file, sha256, rows, …
    configuration : mapping
        Every option in force.
    imu_model : mapping, optional
        Name, source and figures of the sensor error model, units in the keys.
    errors : TrajectoryErrors, optional
        Errors against a reference.
    smoothed_errors : TrajectoryErrors, optional
        The same of the smoothed solution.
    reference_name : str
        What the reference is.
    warnings : sequence of str
        What the user should know.

    Returns
    -------
    dict
        Keys ``versions``, ``configuration``, ``input``, ``imu_model``, ``alignment``, ``solution``,
        ``fixes``, ``aiding``, ``outages``, ``sensor_errors``, ``events``, ``accuracy``, ``smoothed``, ``warnings``.
    """
    facts = {
        "versions": versions(),
        "configuration": configuration,
        "input": reading,
        "imu_model": imu_model,
        "alignment": alignment_facts(run.alignment),
        "solution": _solution_facts(run.solution),
        "fixes": _fix_facts(run),
        "aiding": [asdict(use) for use in run.aiding],
        "outages": [{"start_s": start, "end_s": end, "duration_s": end - start} for start, end in outages(run)],
        "sensor_errors": _sensor_facts(run.sensor_errors),
        "events": dict(sorted(Counter(str(event.kind) for event in run.events).items())),
        "accuracy": _accuracy_facts(errors, reference_name),
        "smoothed": _smoothed_facts(run, errors, smoothed_errors, reference_name),
        "warnings": list(warnings),
    }
    ready: dict[str, Any] = json_ready(facts)
    return ready


def alignment_facts(alignment: Alignment) -> dict[str, Any]:
    """Give an alignment in degrees, units in the keys."""
    roll, pitch, heading = alignment.rph / DEG
    sd_north, sd_east, sd_down = alignment.sd / DEG
    return {
        "time_s": alignment.time,
        "roll_deg": roll,
        "pitch_deg": pitch,
        "heading_deg": heading % 360.0,
        "sd_tilt_north_deg": sd_north,
        "sd_tilt_east_deg": sd_east,
        "sd_heading_deg": sd_down,
        "static_s": alignment.static,
        "level_method": alignment.level_method,
        "heading_method": alignment.heading_method,
        "gyro_bias_deg_h": alignment.gyro_bias / DEG_PER_H,
        "gyro_bias_sd_deg_h": alignment.gyro_bias_sd / DEG_PER_H,
    }


def _solution_facts(solution: Trajectory) -> dict[str, Any]:
    time = solution.time
    if len(time) == 0:
        return {"rows": 0}
    step = np.diff(time)
    distance, moving = distance_and_time(solution)
    return {
        "rows": len(time),
        "start_s": time[0],
        "end_s": time[-1],
        "duration_s": time[-1] - time[0],
        "rate_hz": 1.0 / np.median(step) if len(step) else None,
        "distance_m": distance,
        "moving_s": moving,
        "max_speed_m_s": np.max(np.linalg.norm(solution.v_n, axis=1)),
        "start": _state(solution, 0),
        "end": _state(solution, -1),
    }


def _state(solution: Trajectory, row: int) -> dict[str, Any]:
    lat, lon, height = solution.lla[row]
    state = {"lat_deg": lat / DEG, "lon_deg": lon / DEG, "height_m": height}
    state |= dict(zip(("vn_m_s", "ve_m_s", "vd_m_s"), solution.v_n[row], strict=True))
    state |= dict(zip(("roll_deg", "pitch_deg", "heading_deg"), solution.rph[row] / DEG, strict=True))
    if solution.sd is not None:
        sd = solution.sd[row]
        state |= {
            "sd_position_m": sd[0:3],
            "sd_velocity_m_s": sd[3:6],
            "sd_roll_pitch_heading_deg": sd[6:9] / DEG,
        }
    return state


def _fix_facts(run: Run) -> dict[str, Any]:
    fixes = run.innovations
    kinds = Counter(event.kind for event in run.events)
    return {
        "position": _group_facts(fixes.innovation[:, 0:3], fixes.nis_position, fixes.used_position, "m"),
        "velocity": _group_facts(fixes.innovation[:, 3:6], fixes.nis_velocity, fixes.used_velocity, "m_s"),
        "delay_s": run.gps_delay,
        "delay_sd_s": run.gps_delay_sd,
        "lever_arm_m": run.lever_b,
        "lever_arm_sd_m": run.lever_sd,
        "rejected_for": {reason: kinds[kind] for kind, reason in _REASONS.items() if kinds[kind]},
    }


def _group_facts(innovation: FloatArray, nis: FloatArray, used: BoolArray, unit: str) -> dict[str, Any]:
    known = np.isfinite(innovation)
    offered = known.any(axis=1)
    counted = np.where(known & used[:, None], innovation, np.nan)
    return {
        "offered": int(offered.sum()),
        "used": int((offered & used).sum()),
        "rejected": int((offered & ~used).sum()),
        "nis_mean_per_axis": _mean(nis[used & np.isfinite(nis)] / 3.0),
        f"innovation_rms_{unit}": [_rms(counted[:, axis]) for axis in range(3)],
    }


def _sensor_facts(sensor_errors: SensorErrors) -> dict[str, Any]:
    if len(sensor_errors.time) == 0:
        return {}
    value, sd = sensor_errors.value[-1], sensor_errors.sd[-1]
    facts: dict[str, Any] = {"time_s": sensor_errors.time[-1]}
    for name, unit_name, unit, first in (
        ("gyro_bias", "deg_h", DEG_PER_H, 0),
        ("accel_bias", "mg", 1e-3 * G0, 3),
        ("gyro_scale", "ppm", PPM, 6),
        ("accel_scale", "ppm", PPM, 9),
    ):
        columns = slice(first, first + 3)
        if np.isfinite(value[columns]).any():
            facts[f"{name}_{unit_name}"] = value[columns] / unit
            facts[f"{name}_sd_{unit_name}"] = sd[columns] / unit
    return facts


def _accuracy_facts(errors: TrajectoryErrors | None, reference_name: str) -> dict[str, Any] | None:
    if errors is None:
        return None
    return {
        "reference": reference_name,
        "epochs": len(errors.time),
        "moving_is_faster_than_m_s": MOVING_M_S,
        **accuracy_by_motion(errors),
        "consistency": nees(errors),
    }


def _smoothed_facts(
    run: Run, errors: TrajectoryErrors | None, smoothed_errors: TrajectoryErrors | None, reference_name: str
) -> dict[str, Any] | None:
    """What smoothing brought: uncertainty, and error where there is a reference, beside the filter's."""
    if run.smoothed is None:
        return None
    sd = [_horizontal_sd(solution) for solution in (run.solution, run.smoothed.solution)]
    facts: dict[str, Any] = {"horizontal_sd_m": sd[1], "horizontal_sd_by_filter": _ratio(sd[1], sd[0])}
    if errors is not None and smoothed_errors is not None:
        rms = [_rms(each.horizontal) for each in (errors, smoothed_errors)]
        facts |= {
            "horizontal_rms_by_filter": _ratio(rms[1], rms[0]),
            "accuracy": _accuracy_facts(smoothed_errors, reference_name),
        }
    return facts


def _horizontal_sd(solution: Trajectory) -> float | None:
    return None if solution.sd is None else _rms(np.hypot(solution.sd[:, 0], solution.sd[:, 1]))


def _ratio(value: float | None, by: float | None) -> float | None:
    return value / by if value is not None and by else None


def _mean(values: FloatArray) -> float | None:
    return float(np.mean(values)) if values.size else None


def _rms(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else None
