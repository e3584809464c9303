"""Multi-position calibration without a table: many poses with turns between them, or six positions and three turns.

In six positions each axis is up and down at rest; then a turn about each axis follows.

References
----------
F. Ferraris, U. Grimaldi, M. Parvis, "Procedure for effortless in-field calibration of three-axial rate gyro and
accelerometers", Sensors and Materials 7 (1995) 311-330: accelerometers from sums and differences of opposite
positions, gyros from integrals over the turns.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from insnav.config_file import read_toml
from insnav.exceptions import ConfigError, InputError, reason_of
from insnav.findings import Code, Finding
from insnav.imu.model import ErrorTerms, ImuErrors, RawScale
from insnav.input.formats.table import Table
from insnav.input.interpret.physics import axes_matrix
from insnav.input.readers.imu import read_imu
from insnav.input.readers.reading import Reading, ReadingFacts
from insnav.lab.calibration import BenchOptions, Calibration, CalibrationSd, badly_conditioned, few, warming
from insnav.lab.multi_position import many_positions
from insnav.lab.multi_position.many_positions import Pose, PosesCalibration
from insnav.lab.multi_position.triad import AXES, MultiPosition, Triad, corrected
from insnav.plain_text import plain_text
from insnav.quantity import Quantity
from insnav.sample_statistics import rms
from insnav.strapdown import nominal_interval
from insnav.types import FloatArray, ImuData, Sampling, Stamp
from insnav.units import G0

POSITIONS = tuple(f"{axis}_{way}" for axis in AXES for way in ("p", "a"))
TURNS = tuple(f"{axis}_rot" for axis in AXES)
SECTIONS = POSITIONS + TURNS
TURN_SD = np.deg2rad(1.0)  # accuracy of a manual turn [rad]
OFF_AXIS = 0.5  # largest share of gravity, or of the turn, across the axis of a position or turn
SHORT_TURN = 0.2  # a turn whose angle is wrong by a larger share is rejected
_SAME_POSE = np.deg2rad(20.0)  # largest angle between the poses before and after a turn about the vertical [rad]


@dataclass(frozen=True, slots=True, kw_only=True)
class SixPositions(MultiPosition):
    """Result of a calibration by six positions and three turns."""

    # samples ``first`` up to, not including, ``last`` of ``x_p`` (x up), ``x_a`` (x down), …, ``x_rot``, …
    sections: dict[str, tuple[int, int]]
    angle: float  # angle of each turn [rad]
    # (3,) integrated gyro outputs before calibration, with the sign of the turn [unit of the record times s]
    turned: FloatArray
    force_after: FloatArray  # (6, 3) corrected specific force in each position minus the ideal one [m/s^2]
    # tilt of the positions, one standard deviation, from the disagreement of opposite positions [rad]
    tilt: float


def calibrate_six_positions(
    imu: ImuData,
    g: float,
    sections: Mapping[str, tuple[int, int]] | None = None,
    *,
    turn: float = 2.0 * np.pi,
    counts: bool = False,
) -> SixPositions:
    """Calibrate accelerometers and gyros by six positions and three turns.

    `imu`: record in SI units, or in any units if `counts`. `g`: local gravity [m/s^2]. `sections`: first sample and
    last sample plus one of all `SECTIONS`; by default from `find_sections`. `turn`: angle of each turn [rad]; the gyros
    give its sense. `counts`: sensitivities are unknown.
    Raises: InputError: sections with wrong content, short turns, impossible units. ConfigError: sections that are
    missing or outside the record.
    """
    if imu.sampling == "increment":
        raise InputError("lab.increments")
    bounds = find_sections(imu) if sections is None else check_sections(sections, imu.time.shape[0])
    poses = [many_positions.pose_between(imu, *bounds[name]) for name in POSITIONS]
    force, rate = np.array([p.force for p in poses]), np.array([p.rate for p in poses])
    if not counts:
        many_positions.refuse_force_units(force, g)
    accel, tilt = _accelerometers(force, poses, g)
    _refuse_positions(force, accel, g)
    sensitivity = (rate[0::2] - rate[1::2]).T / (2.0 * g)
    bias = rate.mean(axis=0)  # positions of any length have equal weight, so that g-sensitivity cancels
    bias_sd = ((rate[0::2] + rate[1::2]) / 2.0).std(axis=0, ddof=1) / np.sqrt(3.0)
    integral = np.empty((3, 3))
    for column, name in enumerate(TURNS):
        first, last = bounds[name]
        step = nominal_interval(imu.time[first:last])
        true_force = corrected(accel, imu.accel[first:last])
        integral[:, column] = np.sum(imu.gyro[first:last] - bias - true_force @ sensitivity.T, axis=0) * step
    sign = np.sign(np.diag(integral))
    _refuse_turns(integral, turn, counts)
    matrix = integral / (sign * turn)
    scale = np.abs(np.diag(matrix))
    duration = np.array([imu.time[bounds[n][1] - 1] - imu.time[bounds[n][0]] for n in TURNS])
    # off the diagonal, turn axes are as inaccurate as positions; on the diagonal, the angle of the turn counts
    matrix_sd = np.where(np.eye(3, dtype=bool), TURN_SD / turn, tilt) * scale[:, None]
    matrix_sd = np.hypot(matrix_sd, bias_sd[:, None] * duration / turn)
    gyro = Triad(bias, matrix, bias_sd, matrix_sd, float(np.linalg.cond(matrix / scale[:, None])))
    ideal = _ideal(g)
    corrected_force = corrected(accel, force)
    uncalibrated = force if not counts else (force - accel.bias.mean()) / np.diag(accel.matrix).mean()
    moving = np.ones(imu.time.shape[0], dtype=np.bool_)
    for name in POSITIONS:
        moving[slice(*bounds[name])] = False
    return SixPositions(
        sections=bounds,
        accel=accel,
        gyro=gyro,
        g_sensitivity=sensitivity,
        # each is from two positions, whereas the bias is from six
        g_sensitivity_sd=np.tile(np.sqrt(3.0) * bias_sd[:, None] / g, (1, 3)),
        angle=turn,
        turned=np.diag(integral).copy(),
        force_after=corrected_force - ideal,
        norm_before=np.linalg.norm(uncalibrated, axis=1) - g,
        norm_after=np.linalg.norm(corrected_force, axis=1) - g,
        tilt=tilt,
        clipped=int(np.count_nonzero(many_positions.clipped(imu.gyro, moving))),
        g=g,
        counts=counts,
    )


def _ideal(g: float) -> FloatArray:
    """Return the ideal specific force in the six positions, (6, 3) [unit of `g`]."""
    return np.array([way * g * np.eye(3)[axis] for axis in range(3) for way in (1.0, -1.0)])


def _accelerometers(force: FloatArray, poses: list[Pose], g: float) -> tuple[Triad, float]:
    """Estimate accelerometers from opposite positions, and the tilt of the positions.

    The bias of an axis comes from its two vertical positions: a tilt changes these in second order only. The other
    axes then measure bias plus tilt, so the tilt is a first-order error of the off-diagonal elements.
    """
    up, down = force[0::2], force[1::2]
    mean = (up + down) / 2.0
    matrix = (up - down).T / (2.0 * g)
    bias = np.diag(mean).copy()
    scale = np.diag(matrix)
    cross = ~np.eye(3, dtype=bool)
    tilt = float(np.sqrt(2.0 * np.mean(((mean - bias) / scale)[cross] ** 2)) / g)
    noise = np.array([pose.force_sd / np.sqrt(pose.count) for pose in poses])
    pair = np.sqrt(np.diag(noise[0::2] ** 2 + noise[1::2] ** 2)) / 2.0
    # a tilt of t lowers the specific force of a vertical axis by 1 - cos t
    tilt_sd = np.abs(scale) * g * tilt**2 / np.sqrt(2.0)
    matrix_sd = np.where(cross, np.abs(scale)[:, None] * tilt / np.sqrt(2.0), np.diag(np.hypot(pair, tilt_sd) / g))
    condition = float(np.linalg.cond(matrix / scale[:, None]))
    return Triad(bias, matrix, np.hypot(pair, tilt_sd), matrix_sd, condition), tilt


def _refuse_positions(force: FloatArray, accel: Triad, g: float) -> None:
    scale = np.diag(accel.matrix)
    if (np.abs(scale) < 1e-9 * np.abs(force).max() / g).any():
        raise InputError("lab.positions_alike")
    for name, direction, ideal in zip(POSITIONS, (force - accel.bias) / (np.abs(scale) * g), _ideal(1.0), strict=True):
        axis = int(np.argmax(np.abs(ideal)))
        across = float(np.linalg.norm(np.delete(direction, axis)))
        if direction[axis] * ideal[axis] < 0.0 or across > OFF_AXIS:
            pose = f"{name[0]} {'up' if name.endswith('p') else 'down'}"
            raise InputError("lab.section_pose", section=name, pose=pose, force=tuple(direction.tolist()))


def _refuse_turns(integral: FloatArray, turn: float, counts: bool) -> None:
    for axis, name in enumerate(TURNS):
        angle = abs(integral[axis, axis])
        if float(np.linalg.norm(np.delete(integral[:, axis], axis))) > OFF_AXIS * angle:
            raise InputError(
                "lab.section_axis", section=name, axis=AXES[axis], integrals=tuple(integral[:, axis].tolist())
            )
        if not counts and abs(angle / turn - 1.0) > SHORT_TURN:
            raise InputError(
                "lab.section_angle", section=name, turn_rad=turn, sensor=f"gyro {AXES[axis]}", angle_rad=angle
            )
    angle = np.abs(np.diag(integral))
    if counts and angle.max() > (1.0 + SHORT_TURN) * angle.min():
        raise InputError("lab.turns_unequal", integrals=tuple(angle.tolist()))


def check_sections(sections: Mapping[str, tuple[int, int]], n: int) -> dict[str, tuple[int, int]]:
    """Check that all sections are present and inside the record.

    `sections`: first sample and last sample plus one. `n`: number of samples of the record. Raises: ConfigError:
    missing, unknown and outside sections, all at once.
    """
    missing = tuple(name for name in SECTIONS if name not in sections)
    unknown = tuple(name for name in sections if name not in SECTIONS)
    outside = tuple(name for name, (first, last) in sections.items() if not 0 <= first < last - 2 < n - 1)
    if missing or unknown or outside:
        raise ConfigError(
            "lab.sections_unusable", missing=missing, unknown=unknown, outside=outside, samples=n, known=SECTIONS
        )
    return {name: (int(sections[name][0]), int(sections[name][1])) for name in SECTIONS}


def find_sections(imu: ImuData) -> dict[str, tuple[int, int]]:
    """Find six positions and three turns in a record.

    Positions are the longest stationary spans with each axis up and down. A turn about an axis is between two such
    spans of one pose, with this axis vertical. The largest turn about each axis counts.

    Raises: InputError: positions or turns are missing.
    """
    activity = many_positions.measure_activity(imu)
    poses = many_positions.find_poses(imu, activity, many_positions.FACTORS[2])
    if len(poses) < len(POSITIONS):
        raise InputError("lab.few_spans", count=len(poses))
    force = np.array([pose.force for pose in poses])
    # the middle of opposite extremes is the bias, even of raw counts, with enough accuracy to distinguish up and down
    middle = (force.max(axis=0) + force.min(axis=0)) / 2.0
    half_range = np.maximum((force.max(axis=0) - force.min(axis=0)) / 2.0, 1e-12 * np.abs(force).max())
    up = (force - middle) / half_range
    up /= np.linalg.norm(up, axis=1)[:, None]
    detected: dict[str, tuple[int, int]] = {}
    for name, ideal in zip(POSITIONS, _ideal(1.0), strict=True):
        matching = [pose for pose, way in zip(poses, up, strict=True) if way @ ideal > np.cos(np.arcsin(OFF_AXIS))]
        if matching:
            longest = max(matching, key=lambda pose: pose.count)
            detected[name] = (longest.first, longest.last)
    bias = np.median([pose.rate for pose in poses], axis=0)
    largest: dict[str, float] = {}
    for (a, b), (way, next_way) in zip(itertools.pairwise(poses), itertools.pairwise(up), strict=True):
        first, last = a.last, b.first
        axis = int(np.argmax(np.abs(way)))
        if last - first < 3 or way @ next_way < np.cos(_SAME_POSE) or abs(way[axis]) < np.cos(np.arcsin(OFF_AXIS)):
            continue
        angle = np.abs(np.sum(imu.gyro[first:last] - bias, axis=0)) * activity.interval
        name = TURNS[axis]
        if int(np.argmax(angle)) == axis and angle[axis] > largest.get(name, 0.0):
            largest[name], detected[name] = float(angle[axis]), (first, last)
    missing = tuple(name for name in SECTIONS if name not in detected)
    if missing:
        raise InputError("lab.section_missing", sections=missing, count=len(poses))
    return {name: detected[name] for name in SECTIONS}


def read_sections(path: Path) -> dict[str, tuple[int, int]]:
    """Read the sections of a record from a JSON or TOML file.

    `path`: ``{"x_p": {"start": 0, "end": 500}, …}`` or ``{"x_p": [0, 500], …}``. Returns first sample and last sample
    plus one. Raises: ConfigError: the file cannot be read or understood.
    """
    if path.suffix.lower() == ".toml":
        content = read_toml(path)
    else:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise ConfigError("lab.sections_unreadable", where=str(path), reason=reason_of(error)) from None
    spans, wrong = {}, []
    for name, value in content.items() if isinstance(content, dict) else ():
        pair = [value.get("start"), value.get("end")] if isinstance(value, dict) else value
        if isinstance(pair, list) and len(pair) == 2 and all(type(item) is int for item in pair):
            spans[str(name)] = (pair[0], pair[1])
        else:
            wrong.append(str(name))
    if wrong or not spans:
        raise ConfigError("lab.sections_not_understood", where=str(path), sections=tuple(wrong))
    return spans


Found = PosesCalibration | SixPositions
RAW_UNIT = "LSB"  # unit of a record whose headers state none
FEW_POSES = 20  # with fewer poses, the uncertainty is itself uncertain
ALONE = 0.9  # leverage of a pose that no other pose can check
WARM = 2.0  # larger temperature changes are reported [K]
OVERFIT = 2.0  # larger ratios of left-out to fitted error are reported
DRIFT = 6.0  # larger gyro drifts, in standard deviations of the bias, are reported


def read(files: Sequence[str | Path | Table], how: BenchOptions) -> Reading[ImuData]:
    """Read a record that is stationary in many positions.

    The record has body axes, and SI units or the raw counts of the file. Raises: ConfigError: contradictory options.
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
        use="counts" if how.counts else None,
    )


def fit(record: Reading[ImuData], how: BenchOptions) -> Calibration[ReadingFacts, Found]:
    """Calibrate by `calibrate_poses` or `calibrate_six_positions`.

    The errors refer to the axes of the file, and have a name and the mean temperature. Uncertainty and impact are in SI
    units; for raw units, both assume one zero and one scale factor for three sensors.
    """
    data, sections = record.data, how.sections
    if isinstance(sections, str | Path):
        sections = read_sections(Path(sections))
    result: Found = (
        calibrate_six_positions(data, how.gravity, sections, turn=how.turn, counts=how.counts)
        if how.six
        else many_positions.calibrate_poses(data, how.gravity, counts=how.counts)
    )
    sensed, sd = errors_in_si(result)
    errors = file_errors(
        result,
        axes=axes_matrix(how.axes or "FRD"),
        name=how.name or plain_text(Path(record.facts.path).stem),
        temperature=None if data.temperature is None else float(data.temperature.mean()),
    )
    warnings = _warnings(result, data)
    return Calibration("poses", errors, sd, _parameters(result), {}, record.facts, result, how, warnings, sensed)


def file_errors(
    found: Found, *, axes: FloatArray | None = None, name: str = "", temperature: float | None = None
) -> ImuErrors:
    """Build errors for the calibration file: bias, matrix and g-sensitivity; for raw units also zero and scale.

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
    rotation = np.eye(3) if axes is None else axes
    gyro, accel = np.diag(found.gyro.matrix)[:, None], np.diag(found.accel.matrix)[:, None]
    return ImuErrors(
        gyro_matrix=found.gyro.matrix / gyro,
        accel_matrix=found.accel.matrix / accel,
        name=name,
        temperature=temperature,
        gyro_raw=_raw(found.gyro, rotation),
        accel_raw=_raw(found.accel, rotation),
        gyro_terms=ErrorTerms(g_sensitivity=found.g_sensitivity / gyro),
    )


def _raw(triad: Triad, axes: FloatArray) -> RawScale:
    return RawScale(RAW_UNIT, axes.T @ triad.bias, np.abs(axes).T @ np.diag(triad.matrix))


def errors_in_si(found: Found) -> tuple[ImuErrors, CalibrationSd]:
    """Convert errors and their uncertainty to SI units; for raw units, three sensors share one zero and one scale."""
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
    gain = abs(scale)
    bias = (triad.bias - triad.bias.mean()) / scale
    return Triad(bias, triad.matrix / scale, triad.bias_sd / gain, triad.matrix_sd / gain, triad.condition), scale


def _parameters(found: Found) -> tuple[Quantity, ...]:
    items = []
    for sensor, unit, triad in (("accel", "m/s^2", found.accel), ("gyro", "rad/s", found.gyro)):
        bias_unit, matrix_unit = (RAW_UNIT, f"{RAW_UNIT}/({unit})") if found.counts else (unit, "")
        items.append(Quantity(f"{sensor}_bias", triad.bias, bias_unit, triad.bias_sd))
        items.append(Quantity(f"{sensor}_matrix", triad.matrix, matrix_unit, triad.matrix_sd))
    g_sensitivity_unit = f"{RAW_UNIT}/(m/s^2)" if found.counts else "(rad/s)/(m/s^2)"
    items.append(Quantity("gyro_g_sensitivity", found.g_sensitivity, g_sensitivity_unit, found.g_sensitivity_sd))
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
    for what, fitted, left_out in (
        ("gravity", found.norm_after, found.norm_left_out),
        ("turns", found.turn_after[found.turn_used], found.turn_left_out[found.turn_used]),
    ):
        if rms(left_out) > OVERFIT * rms(fitted):
            ratio = rms(left_out) / rms(fitted)
            warnings.append(Finding.of(Code.BENCH_OVERFIT, ratio=ratio, limit_ratio=OVERFIT, what=what))
    drift = np.abs(found.gyro_drift)
    if (drift > DRIFT * np.abs(np.linalg.solve(found.gyro.matrix, found.gyro.bias_sd))).any():
        warnings.append(Finding.of(Code.BENCH_DRIFT, subject="gyro", drift_rad_s=drift.max()))
    return warnings
