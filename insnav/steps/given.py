"""Inputs from the user: checks, initial estimates, and the filter built from both."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from insnav import spill
from insnav.alignment import Mounting, find_mounting, find_stationary
from insnav.alignment.in_motion import positions_alone
from insnav.alignment.mounting import AS_IS, RARE
from insnav.exceptions import ConfigError, InputError
from insnav.explain.kinds import with_priors
from insnav.filter.delay_and_lever import Aligned
from insnav.filter.innovation_likelihood import LONGEST
from insnav.filter.prepare import GivenStart, Start, first_stationary, prepare
from insnav.filter.receiver import DELAY_SD, LEVER_SD, Delay, LeverArm, Receiver
from insnav.findings import Code, Finding
from insnav.imu import load_imu
from insnav.imu.imu_file import part_of
from insnav.imu.specification import PRESETS, ImuSpec
from insnav.input import Reading, ReadingFacts
from insnav.input.interpret.columns import quote_columns
from insnav.input.interpret.physics import course_of, turn_ratio, turns_with_course
from insnav.steps import Model, Recording
from insnav.steps.inputs import INPUTS, LOGS, Inputs
from insnav.strapdown import intervals
from insnav.types import FloatArray, GpsData, ImuData, Trajectory
from insnav.units import DEG

_LONGEST_LEVER = 100.0  # a longer lever arm must be in another unit [m]


def checked(inputs: Inputs) -> Inputs:
    """Check the inputs, and read the initial state if it is a file.

    Raises: ConfigError: an unknown name, or an invalid value; `where` is the name. InputError: the file of the initial
    state cannot be read or is incomplete.
    """
    for key, value in inputs.items():
        if key not in INPUTS:
            raise ConfigError(
                "input.unknown_input", value=key, known=tuple("imu" if name == "imu_model" else name for name in INPUTS)
            )
        item = INPUTS[key]
        # this comparison also rejects NaN
        if isinstance(value, int | float) and not item.low <= value / item.size <= item.high:
            raise ConfigError(
                "input.out_of_range", where=key, value=value / item.size, low=item.low, high=item.high, unit=item.unit
            )
        if value is not None and item.choices:
            one_of(key, value, item.choices)
    with_priors(inputs.get("faults") or {})
    vector("lever_arm", inputs.get("lever_arm"))
    vector("ref_lever_arm", inputs.get("ref_lever_arm"))
    span = inputs.get("static")
    if span is not None and not span[1] > span[0]:
        raise ConfigError("input.bad_span", where="static", span_s=(float(span[0]), float(span[1])))
    reference_sd(inputs)
    for name in inputs.get("logs") or {}:
        if name not in LOGS:
            raise ConfigError("input.unknown_sensor", where="logs", value=str(name), known=tuple(LOGS))
    initial = inputs.get("initial")
    return {**inputs, "initial": read_start(Path(initial)) if isinstance(initial, str | Path) else initial}


def as_given(inputs: Inputs) -> bool:
    """Test whether no noise and no faults are estimated from the whole record: the filter uses earlier data only."""
    return Inputs(noise="model", explain="off").items() <= inputs.items()


def one_of(name: str, value: object, known: Sequence[object]) -> None:
    """Refuse a word or number that is not known."""
    if value not in known:
        raise ConfigError("input.unknown_word", where=name, value=str(value), known=tuple(map(str, known)))


def vector(key: str, value: Sequence[float] | FloatArray | None) -> FloatArray | None:
    """Validate a lever arm or output point ``(3,)`` in body axes [m], and return it; None if unspecified."""
    if value is None:
        return None
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ConfigError("input.not_a_vector", where=key, value=str(value))
    if float(np.linalg.norm(array)) > _LONGEST_LEVER:
        raise ConfigError("input.long_lever_arm", where=key, lever_m=tuple(array.tolist()), limit_m=_LONGEST_LEVER)
    return array


def reference_point(inputs: Inputs, reference: Trajectory) -> FloatArray | None:
    """Return the point of a reference seen from the IMU, body axes ``(3,)`` [m]; None for the antenna.

    A reference with attitude is an inertial solution, at its IMU. Positions alone belong to a receiver antenna, assumed
    to be the antenna of the drive.
    """
    given = vector("ref_lever_arm", inputs.get("ref_lever_arm"))
    if given is not None:
        return given
    return np.zeros(3) if np.isfinite(reference.rph).any() else None


def reference_sd(inputs: Inputs) -> tuple[float, float | None] | None:
    """Return the sd of the reference: position [m], and velocity [m/s] if specified."""
    value = inputs.get("ref_sd")
    if value is None:
        return None
    numbers = [float(each) for each in np.atleast_1d(value)]
    if len(numbers) > 2 or not all(0.0 < each < math.inf for each in numbers):
        raise ConfigError("input.bad_ref_sd", where="ref_sd", value=str(value))
    return numbers[0], numbers[1] if len(numbers) == 2 else None


def options_of(inputs: Inputs, **others: object) -> dict[str, object]:
    """Return all specified inputs, for `insnav.result.Result.options`."""
    named = {key: value.name if isinstance(value, ImuSpec) else value for key, value in inputs.items()}
    return {key: value for key, value in {**named, **others}.items() if value is not None}


_START_KEYS = dict.fromkeys(("time_s", "lat_deg", "lon_deg", "height_m"), 0) | dict.fromkeys(
    ("v_n_m_s", "roll_pitch_heading_deg", "sd_position_m", "sd_velocity_m_s", "sd_attitude_deg"), 3
)


def read_start(path: Path) -> Start:
    """Read an initial state from a JSON file.

    Raises: InputError: the file cannot be read, or is incomplete.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError("input.unreadable_start", where=str(path), reason=str(error)) from error
    values: dict[str, FloatArray] = {}
    invalid = []
    for key, length in _START_KEYS.items():
        try:
            value = np.asarray(content[key], dtype=float)
        except (KeyError, TypeError, ValueError):
            value = np.array(np.nan)
        good = value.shape == ((length,) if length else ()) and np.isfinite(value).all()
        if not good or (key.startswith("sd_") and not (value > 0).all()):
            invalid.append(key)
        values[key] = value
    if invalid:
        raise InputError("input.incomplete_start", where=f"{path}: {', '.join(invalid)}")
    time, lat, lon, height, v_n, rph, place_sd, velocity_sd, attitude_sd = values.values()
    place = np.array([lat * DEG, lon * DEG, height])
    return Start(float(time), place, v_n, rph * DEG, place_sd, velocity_sd, attitude_sd * DEG)


def given_model(recording: Recording) -> Model:
    """Build the model before the first step, from the inputs."""
    inputs = recording.inputs
    return Model(given_receiver(inputs, fixes=recording.gps is not None), given_imu(inputs.get("imu_model")))


def given_receiver(inputs: Inputs, *, fixes: bool = True) -> Receiver:
    """Build the receiver from the inputs. With `fixes`, the filter estimates an unspecified lever arm or delay."""
    lever_b, sd, delay = (
        vector("lever_arm", inputs.get("lever_arm")),
        inputs.get("lever_arm_sd"),
        inputs.get("gps_delay"),
    )
    lever_arm = LeverArm(sd=LEVER_SD * fixes, source="prior") if lever_b is None else LeverArm(lever_b)
    return Receiver(
        lever_arm if sd is None else replace(lever_arm, sd=sd),
        Delay(sd=DELAY_SD * fixes, source="prior") if delay is None else Delay(delay),
        heading_sd=inputs.get("gps_heading_sd") or 0.0,
    )


def given_imu(model: object) -> tuple[ImuSpec, Finding] | None:
    """Return the specified IMU model and its source; None if the data choose it.

    Parameters missing in a datasheet are completed from the grade of the IMU: the filter would take zeros as exact.
    """
    if model is None:
        return None
    part = None if isinstance(model, ImuSpec) else part_of(str(model))
    if part is not None:
        from insnav.imu.library import completed

        spec, taken = completed(part, load_imu(part.grade))
        return spec, Finding.of(Code.IMU_MODEL_PART, model=str(model), grade=part.grade, taken=taken)
    if isinstance(model, ImuSpec):
        return model, Finding.of(Code.IMU_MODEL_GIVEN, absent=model.absent)
    spec = load_imu(str(model))
    return spec, Finding.of(Code.IMU_MODEL_FILE, model=str(model), absent=spec.absent)


def better_kinds(inputs: Inputs, chosen: ImuSpec) -> tuple[ImuSpec, ...]:
    """Return the grades better than `chosen`, which an unspecified IMU may have. Poorer grades would absorb faults."""
    if inputs.get("imu_model") is not None:
        return ()
    return tuple(map(load_imu, PRESETS[PRESETS.index(chosen.name) + 1 :]))


def set_up_filter(
    recording: Recording, model: Model, clock: float = 0.0, rate: float = 0.0, heading: float | None = None
) -> Aligned:
    """Align a recording and set the filter up.

    `clock`, `rate`: shift of the sample times at the start [s], and its rate [s/s]. `heading`: at the start [rad].
    """
    inputs, imu = recording.inputs, recording.imu.data
    assert recording.fixes is not None
    assert model.imu is not None
    initial, span = inputs.get("initial"), inputs.get("static")
    begin, end = float(imu.time[0]), float(imu.time[-1])

    def moved(time: Any) -> Any:
        return time + clock + rate * (time - begin)

    ready, findings = prepare(
        replace(imu, time=spill.by_blocks(moved, imu.time)),
        recording.fixes,
        model.imu[0],
        model.receiver,
        states=model.task.states,
        known=GivenStart(
            replace(initial, time=moved(initial.time)) if isinstance(initial, Start) else None,
            None if span is None else (moved(span[0]), moved(span[1])),
            heading,
            model.mounting_yaw.value,
        ),
        as_given=as_given(inputs),
    )
    if height_sd := inputs.get("fixed_height_sd"):
        ready = ready.hold_height(height_sd)
    logs = tuple(replace(log.data, time=moved(log.data.time)) for log in recording.logs.values())
    ready = replace(ready, aiding=replace(ready.aiding, logs=logs))
    return Aligned(ready, findings, clock + 0.5 * rate * (end - begin), rate)


def stationary_part(imu: ImuData, fixes: GpsData | None, inputs: Inputs) -> tuple[float, float] | None:
    """Return the specified stationary interval, else the first one by IMU and GPS, or by the IMU alone [s]."""
    span = inputs.get("static")
    if span is not None:
        return span
    return find_stationary(intervals(imu)) if fixes is None else first_stationary(imu, fixes)


WORDS = {"F": "forward", "B": "back", "R": "right", "L": "left", "D": "down", "U": "up"}


def refuse_unlike_gyros(imu: Reading[ImuData], fixes: GpsData) -> None:
    """Refuse gyros in another order than the accelerometers, or one gyro in another unit."""
    mounting = mounting_of(imu, fixes)
    if mounting is not None and not np.array_equal(np.abs(mounting.gyros), AS_IS):
        raise refusal(mounting, imu.facts)


def accel_reversed(imu: Reading[ImuData], fixes: GpsData, mounting: Mounting | None) -> Finding | None:
    """Report accelerometers that all have the opposite sign of the specific force; None otherwise.

    `mounting`: mounting that explains the fixes. If None, the course decides, unless gravity shows inverted gyros.
    """
    if mounting is not None:
        reverse = mounting.mirrored and np.array_equal(mounting.gyros, AS_IS)
        return Finding.of(Code.AXES_ACCEL_REVERSED, windows=mounting.windows) if reverse else None
    data = imu.data.beginning(LONGEST)
    correlation = turns_with_course(data.time, data.gyro, data.accel, fixes.time, course_of(fixes.v_n))
    if correlation >= 0.0 or turn_ratio(data.time, data.gyro, data.accel)[1] < 0.0:
        return None
    return Finding.of(Code.AXES_ACCEL_REVERSED, correlation=correlation)


def refuse_exchanged(
    imu: Reading[ImuData], gps: Reading[GpsData] | None, fixes: GpsData, mounting: Mounting | None
) -> None:
    """Refuse exchanged latitudes and longitudes: the corrected track fits the samples better than `mounting` does."""
    right, lla = _headers({"lat": "lon", "lon": "lat"}, gps.facts if gps is not None else None), fixes.lla[:, [1, 0, 2]]
    if gps is None or not right or np.abs(lla[:, 0]).max() >= 0.5 * np.pi:
        return
    found = mounting_of(imu, positions_alone(replace(fixes, lla=lla)))
    if found is not None and found.right_handed and (mounting is None or found.gain(mounting) > RARE):
        values: dict[str, Any] = {"option": "--gps-columns", "columns": quote_columns(right), "windows": found.windows}
        gives = {"gps_columns": right}
        raise InputError("mounting.positions_exchanged", where=gps.facts.path, gives=gives, **values)


def mounting_of(imu: Reading[ImuData], fixes: GpsData) -> Mounting | None:
    """Estimate the mounting from the first half hour. Its axes may be left-handed, if the columns are wrong."""
    return find_mounting(intervals(imu.data.beginning(LONGEST)), fixes)


def refusal(mounting: Mounting, facts: ReadingFacts) -> InputError:
    """Build the error for left-handed axes, or for gyros in a wrong unit, sign or order."""
    where, windows = facts.path, mounting.windows
    sizes = np.abs(mounting.gyros).sum(axis=0)
    if (sizes != 1.0).any():
        units = ("deg/s", "rad/s") if sizes.min() < 1.0 else ("rad/s", "deg/s")
        odd = int(np.argmin((sizes[:, None] == sizes).sum(axis=0)))
        if sizes[odd] == 1.0:
            units = units[::-1]
        values: dict[str, Any] = {"axis": "xyz"[odd], "unit": units[0], "others": units[1]}
        return InputError("mounting.gyro_unit_odd", where=where, windows=windows, **values)
    accel, gyro = mounting.corrections
    points = tuple(WORDS[letter] for letter in mounting.letters)
    axes, as_is = tuple("xyz"[axis] for axis in range(3) if accel[axis, axis] < 0.0), np.array_equal(gyro, np.eye(3))
    if np.array_equal(accel, np.eye(3)):
        axes = tuple("xyz"[axis] for axis in range(3) if gyro[axis, axis] < 0.0)
        if np.count_nonzero(np.diag(gyro)) == 3:
            return InputError("mounting.gyros_wrong_way", where=where, axes=axes, windows=windows)
        return InputError("mounting.gyro_order", where=where, windows=windows, **_in_order("gyro", gyro, facts))
    if as_is and len(axes) == 3:
        gives = {"accel_sign": "minus-force"}
        return InputError("mounting.accelerometers_inverted", where=where, gives=gives, windows=windows)
    if as_is and np.count_nonzero(np.diag(accel)) == 3:
        return InputError("mounting.accelerometer_inverted", where=where, axis=axes[0], points=points, windows=windows)
    if as_is:
        return InputError("mounting.accel_order", where=where, windows=windows, **_in_order("accel", accel, facts))
    return InputError("mounting.left_handed", where=where, points=points, windows=windows)


def _headers(keys: Mapping[str, str], facts: ReadingFacts | None) -> dict[str, str]:
    """Return, by key of `keys`, the file header of the column that was read as the value; empty if one is unknown."""
    columns = {} if facts is None else {name: text.split(" [")[0] for name, text in facts.columns.items()}
    headers = {key: [text for name, text in columns.items() if name.startswith(keys[key])] for key in keys}
    return {key: texts[0] for key, texts in headers.items()} if all(headers.values()) else {}


def _in_order(sensor: str, matrix: FloatArray, facts: ReadingFacts) -> dict[str, Any]:
    """Return the right order of the columns, the axes that they measure, and their headers if no sign is wrong."""
    signed = matrix.sum(axis=1), matrix.sum(axis=0)
    order, about = (
        tuple(
            ("-" if size < 0.0 else "") + "xyz"[at] for size, at in zip(sizes, np.abs(rows).argmax(axis=1), strict=True)
        )
        for sizes, rows in zip(signed, (matrix, matrix.T), strict=True)
    )
    keys = {f"{sensor}_{axis}": f"{sensor}_{other}" for axis, other in zip("xyz", order, strict=True) if axis != other}
    headers = _headers(keys, facts)
    hint: dict[str, Any] = {"columns": quote_columns(headers), "gives": {"columns": headers}} if headers else {}
    return {"about": about, "order": order, "option": "--columns", "columns": "", **hint}
