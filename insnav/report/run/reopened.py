"""A saved run read again: everything that its page and figures show."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from insnav.errors.evaluated_run import EvaluatedRun
from insnav.errors.metrics import TrajectoryErrors
from insnav.exceptions import InputError
from insnav.output.folder import read_facts
from insnav.output.solution_tables import has_smoothed, read_events, read_run_table, read_solution
from insnav.report.run.backdrop import FILE as BACKDROP
from insnav.report.run.backdrop import read_backdrop
from insnav.types import (
    AidingUse,
    Alignment,
    Epochs,
    FloatArray,
    GpsData,
    Innovations,
    Run,
    SensorErrors,
    Smoothed,
)
from insnav.units import DEG, DEG_PER_H


def read_found(folder: Path) -> EvaluatedRun:
    """Read a run from its folder; covariances between filter epochs and the short-duration windows are not kept.

    Raises: InputError: a table is missing or damaged.
    """
    facts = read_facts(folder)
    try:
        fixes, aiding = facts["fixes"], facts["aiding"]
        alignment = _alignment(facts["alignment"])
    except (KeyError, TypeError) as error:
        raise InputError(
            "run.json is not that of a run of this version", where=str(folder), why=f"no {error}", fix="make it again"
        ) from error
    none = np.empty(0)
    epochs = Epochs(none, np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 4)), np.empty((0, 9, 9)))
    sensor_errors = read_run_table(folder, SensorErrors)
    smoothed = None
    if has_smoothed(folder):
        biases = read_run_table(folder, SensorErrors, "smoothed_biases")
        smoothed = Smoothed(read_solution(folder, "smoothed"), epochs, biases)
    run = Run(
        read_solution(folder),
        read_run_table(folder, Innovations),
        sensor_errors,
        read_events(folder),
        alignment,
        epochs,
        fixes["delay_s"],
        fixes["delay_sd_s"],
        np.array(fixes["lever_arm_m"]),
        np.array(fixes["lever_arm_sd_m"]),
        smoothed,
        tuple(_aiding(each) for each in aiding),
    )
    errors, smoothed_errors = (
        read_run_table(folder, TrajectoryErrors, name) if any(folder.glob(f"{name}.*")) else None
        for name in ("errors", "smoothed_errors")
    )
    gps = read_run_table(folder, GpsData) if any(folder.glob("fixes.*")) else None
    backdrop = read_backdrop(folder / BACKDROP) if (folder / BACKDROP).is_file() else None
    return EvaluatedRun(run, gps, errors, smoothed_errors, backdrop=backdrop)


def _alignment(facts: Mapping[str, Any]) -> Alignment:
    rph = (facts[f"{name}_deg"] for name in ("roll", "pitch", "heading"))
    sd = (facts[f"{name}_sd_deg"] for name in ("tilt_north", "tilt_east", "heading"))
    bias, bias_sd = (_array(facts[f"gyro_bias{name}_deg_h"]) * DEG_PER_H for name in ("", "_sd"))
    return Alignment(
        facts["time_s"],
        _array(rph) * DEG,
        _array(sd) * DEG,
        bias,
        np.where(np.isnan(bias_sd), np.inf, bias_sd),
        None if facts["static_s"] is None else tuple(facts["static_s"]),
        facts["level_method"],
        facts["heading_method"],
    )


def _array(values: Any) -> FloatArray:
    return np.array(list(values), dtype=np.float64)


def _aiding(facts: Mapping[str, Any]) -> AidingUse:
    key = next(key for key in facts if key.startswith("innovation_rms_"))
    unit = key.removeprefix("innovation_rms_").replace("_", "/")
    return AidingUse(facts["name"], facts["processed"], facts["rejected"], facts[key], facts["nis"], unit)
