"""Multi-position calibration without a table: many poses with turns between them, or six positions and three turns."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np

from insnav.exceptions import ConfigError
from insnav.findings import Code, Finding
from insnav.imu.higher_order import ErrorTerms
from insnav.imu.model import ImuErrors
from insnav.imu.raw_outputs import RawScale
from insnav.input.formats.table import Table
from insnav.input.interpret.axes import axes_matrix
from insnav.input.readers.imu import read_imu
from insnav.input.readers.reading import Reading, ReadingFacts
from insnav.lab.calibration import BenchOptions, Calibration, CalibrationSd, badly_conditioned, few, warming
from insnav.lab.multi_position.many_positions import PosesCalibration, calibrate_poses
from insnav.lab.multi_position.six_positions import SixPositions, calibrate_six_positions, read_sections
from insnav.lab.multi_position.triad import Triad
from insnav.plain_text import plain_text
from insnav.quantity import Quantity
from insnav.sample_statistics import rms
from insnav.types import FloatArray, ImuData, Sampling, Stamp
from insnav.units import G0

Found = PosesCalibration | SixPositions
RAW_UNIT = "LSB"  # of a record whose headers state none
FEW_POSES = 20  # below, the uncertainty is itself uncertain
ALONE = 0.9  # leverage of a pose that no other pose can check
WARM = 2.0  # reported change of temperature [K]
OVERFIT = 2.0  # ratio of left-out to fitted error
DRIFT = 6.0  # significance of a gyro drift in standard deviations of its bias


def read(files: Sequence[str | Path | Table], how: BenchOptions) -> Reading[ImuData]:
    """Read a record that is stationary in many positions.

    In SI units, or of raw counts as in the file; in body axes. Raises: ConfigError: options that contradict each other.
    """
    if not how.six and how.sections is not None:
        raise ConfigError("lab.sections_need_six", where="--sections")
    if how.counts and (how.units or how.sampling or how.stamp):
        raise ConfigError("lab.counts_have_no_units", where="--counts")
    if not 0.5 * np.pi <= how.turn <= 200.0 * np.pi:
        raise ConfigError("lab.turn_angle", where="--turn", turn_rad=how.turn)
    return read_imu(
        files[0],
        axes=how.axes or "FRD",  # a bench record shows any side up: axes are not inferred from it
        columns=how.columns,
        units=how.units,
        sampling=cast("Sampling | None", how.sampling),
        stamp=cast("Stamp | None", how.stamp),
        bench="counts" if how.counts else None,
    )


def fit(record: Reading[ImuData], how: BenchOptions) -> Calibration[ReadingFacts, Found]:
    """Calibrate by `calibrate_poses` or `calibrate_six_positions`.

    The errors have the axes of the file, a name and the mean temperature. Uncertainty and impact are in SI units; raw
    units use one zero and one scale factor for three sensors.
    """
    data, sections = record.data, how.sections
    if isinstance(sections, str | Path):
        sections = read_sections(Path(sections))
    found: Found = (
        calibrate_six_positions(data, how.gravity, sections, turn=how.turn, counts=how.counts)
        if how.six
        else calibrate_poses(data, how.gravity, counts=how.counts)
    )
    sensed, sd = errors_in_si(found)
    errors = file_errors(
        found,
        axes=axes_matrix(how.axes or "FRD"),
        name=how.name or plain_text(Path(record.facts.path).stem),
        temperature=None if data.temperature is None else float(data.temperature.mean()),
    )
    warnings = _warnings(found, data)
    return Calibration("poses", errors, sd, _parameters(found), {}, record.facts, found, how, warnings, sensed)


def file_errors(
    found: Found, *, axes: FloatArray | None = None, name: str = "", temperature: float | None = None
) -> ImuErrors:
    """Build errors for the calibration file: bias, matrix and g-sensitivity; for raw units zero and scale, too.

    `axes` (3, 3): from file axes to body axes, as read; zero and scale belong to the sensors of the file. `name`: of
    the sensor. `temperature`: mean temperature [deg C].
    """
    if not found.counts:
        return ImuErrors(
            found.gyro.bias,
            found.gyro.matrix,
            found.accel.bias,
            found.accel.matrix,
            name=name,
            temperature=temperature,
            gyro_terms=ErrorTerms(g_sensitivity=found.g_sensitivity),
        )
    turn = np.eye(3) if axes is None else axes
    gyro, accel = np.diag(found.gyro.matrix)[:, None], np.diag(found.accel.matrix)[:, None]
    return ImuErrors(
        gyro_matrix=found.gyro.matrix / gyro,
        accel_matrix=found.accel.matrix / accel,
        name=name,
        temperature=temperature,
        gyro_raw=_raw(found.gyro, turn),
        accel_raw=_raw(found.accel, turn),
        gyro_terms=ErrorTerms(g_sensitivity=found.g_sensitivity / gyro),
    )


def _raw(triad: Triad, axes: FloatArray) -> RawScale:
    return RawScale(RAW_UNIT, axes.T @ triad.bias, np.abs(axes).T @ np.diag(triad.matrix))


def errors_in_si(found: Found) -> tuple[ImuErrors, CalibrationSd]:
    """Errors in SI units and their uncertainty; of raw units against one zero and one scale for three sensors."""
    gyro, gyro_scale = _in_si(found.gyro, found.counts)
    accel, _ = _in_si(found.accel, found.counts)
    terms = ErrorTerms(g_sensitivity=found.g_sensitivity / gyro_scale)
    return ImuErrors(gyro.bias, gyro.matrix, accel.bias, accel.matrix, gyro_terms=terms), CalibrationSd(
        gyro_bias=gyro.bias_sd,
        gyro_matrix=gyro.matrix_sd,
        accel_bias=accel.bias_sd,
        accel_matrix=accel.matrix_sd,
        g_sensitivity=found.g_sensitivity_sd / abs(gyro_scale),
    )


def _in_si(triad: Triad, counts: bool) -> tuple[Triad, float]:
    if not counts:
        return triad, 1.0
    scale = float(np.mean(np.diag(triad.matrix)))
    size = abs(scale)
    bias = (triad.bias - triad.bias.mean()) / scale
    return Triad(bias, triad.matrix / scale, triad.bias_sd / size, triad.matrix_sd / size, triad.condition), scale


def _parameters(found: Found) -> tuple[Quantity, ...]:
    items = []
    for sensor, unit, triad in (("accel", "m/s^2", found.accel), ("gyro", "rad/s", found.gyro)):
        of_bias, of_matrix = (RAW_UNIT, f"{RAW_UNIT}/({unit})") if found.counts else (unit, "")
        items.append(Quantity(f"{sensor}_bias", triad.bias, of_bias, triad.bias_sd))
        items.append(Quantity(f"{sensor}_matrix", triad.matrix, of_matrix, triad.matrix_sd))
    of_force = f"{RAW_UNIT}/(m/s^2)" if found.counts else "(rad/s)/(m/s^2)"
    items.append(Quantity("gyro_g_sensitivity", found.g_sensitivity, of_force, found.g_sensitivity_sd))
    return tuple(items)


def _warnings(found: Found, imu: ImuData) -> tuple[Finding, ...]:
    warnings = _pose_warnings(found) if isinstance(found, PosesCalibration) else []
    if found.clipped:
        warnings.append(Finding.of(Code.BENCH_CLIPPED, subject="gyro", count=found.clipped))
    warnings += warming(imu.temperature, WARM)
    share = np.linalg.norm(np.linalg.solve(found.gyro.matrix, found.g_sensitivity), axis=1)
    limit = np.linalg.norm(np.linalg.solve(found.gyro.matrix, np.diag(found.gyro.bias_sd)), axis=1)
    if (G0 * share > 3.0 * limit).any():
        warnings.append(Finding.of(Code.BENCH_G_SENSITIVITY, subject="gyro", sensitivity_rad_s_per_m_s2=share.max()))
    return tuple(warnings)


def _pose_warnings(found: PosesCalibration) -> list[Finding]:
    warnings = [
        *few("poses", len(found.poses), FEW_POSES),
        *badly_conditioned({"accel": found.accel, "gyro": found.gyro}),
    ]
    alone = tuple((np.flatnonzero(found.accel_share > ALONE) + 1).tolist())
    if alone:
        warnings.append(Finding.of(Code.BENCH_SINGLE_POSE, subject="accel", pose=alone, limit_share=ALONE))
    unused = int(np.count_nonzero(~found.turn_used))
    if unused:
        warnings.append(Finding.of(Code.BENCH_UNUSED_TURNS, count=unused))
    for what, fitted, other in (
        ("gravity", found.norm_after, found.norm_left_out),
        ("turns", found.turn_after[found.turn_used], found.turn_left_out[found.turn_used]),
    ):
        if rms(other) > OVERFIT * rms(fitted):
            ratio = rms(other) / rms(fitted)
            warnings.append(Finding.of(Code.BENCH_OVERFIT, ratio=ratio, limit_ratio=OVERFIT, what=what))
    drift = np.abs(found.gyro_drift)
    bias_sd = np.abs(np.linalg.solve(found.gyro.matrix, found.gyro.bias_sd))
    if (drift > DRIFT * bias_sd).any():
        warnings.append(Finding.of(Code.BENCH_DRIFT, subject="gyro", drift_rad_s=drift.max()))
    return warnings
