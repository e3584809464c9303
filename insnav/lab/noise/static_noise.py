"""Noise of an IMU from a stationary record: Allan deviations, models, floors, figures for a filter, and warnings.

A filter cannot represent flicker noise: a first-order Gauss-Markov process replaces the bias instability. Its Allan
deviation peaks at 1.89 correlation times with 0.617 of its standard deviation (0.437 q sqrt(T) with sd = q sqrt(T / 2);
IEEE Std 952-1997, annex C, exponentially correlated noise). If the fit contains such a process, its values are used. If
the fit has a flat floor, the peak is placed on the floor. The file then omits the floor as flicker noise, because
simulations would have the bias instability twice.

Quantisation and rate ramp go into the file for simulations; filters ignore them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.imu.health import inspect
from insnav.imu.specification import ImuSpec, SensorSpec, terms_of
from insnav.lab.calibration import about, warming
from insnav.lab.noise import allan as noise
from insnav.lab.noise.allan import AllanDeviation, EvenRecord, NoiseModel, Sinusoid, evaluated
from insnav.types import BoolArray, FloatArray, ImuData
from insnav.units import DEG

PEAK_TIME = 1.8926  # averaging time at the peak of the Allan deviation of a Gauss-Markov process, in correlation times
PEAK = 0.61736  # height of this peak, in standard deviations of the process
KEYS = {term.allan: term.key for term in terms_of("gyro") if term.allan}  # by coefficient: key of the IMU file
FLOOR_FREEDOM = 10.0  # least degrees of freedom of a floor


@dataclass(frozen=True, slots=True)
class Floor:
    """Lowest reliable point of an Allan deviation."""

    value: float  # in the unit of the signal
    tau: float  # averaging time [s]
    reached: bool  # True: the curve does not fall further at longer times; False: it is still falling


def floor_of(allan: AllanDeviation, column: int, model: NoiseModel) -> Floor:
    """Find the lowest point of an Allan deviation with at least ten degrees of freedom.

    `column`: axis. `model`: its degrees of freedom are used, and whether it has terms that do not fall with time.
    """
    reliable = np.flatnonzero(model.freedom >= FLOOR_FREEDOM)
    rows = reliable if reliable.size else np.arange(1)
    row = int(rows[np.argmin(allan.deviation[rows, column])])
    reached = any(name in model.coefficients for name in ("B", "GM", "K", "R"))
    return Floor(float(allan.deviation[row, column]), float(allan.tau[row]), reached)


def imu_spec(
    allan: AllanDeviation, models: tuple[NoiseModel | None, ...], name: str, source: str
) -> tuple[ImuSpec, tuple[Finding, ...]]:
    """Build the IMU specification for a filter from the noise of six axes.

    `allan`: columns gyro x, y, z, accelerometer x, y, z. `models`: one per axis; None for an axis without any noise.
    `name`, `source`: for the file. Returns spec: random walk, bias instability with its correlation time, rate random
    walk, and to simulate quantisation and rate ramp. Turn-on bias, scale factor and misalignment are absent: one record
    at rest does not show them; notes: origin of each figure.
    """
    notes: list[Finding] = []
    absent: list[str] = []
    sensors = []
    for first, sensor in ((0, "gyro"), (3, "accel")):
        spec, missing, reasons = _sensor(allan, models[first : first + 3], first, sensor)
        sensors.append(spec)
        notes += reasons
        absent += [f"{sensor}.{key}" for key in ("bias", "scale_factor", "misalignment", *missing)]
    notes.append(Finding.of(Code.ALLAN_UNSEEN))
    return ImuSpec(name, sensors[0], sensors[1], None, source, tuple(absent)), tuple(notes)


def _sensor(
    allan: AllanDeviation, models: tuple[NoiseModel | None, ...], first: int, sensor: str
) -> tuple[SensorSpec, list[str], list[Finding]]:
    instability = np.zeros(3)
    times: list[float] = []
    notes: list[Finding] = []
    for axis, model in enumerate(models):
        if model is None:
            continue
        sd, time, reason = _process(allan, first + axis, model)
        instability[axis] = sd
        if sd > 0.0:
            times.append(time)
        notes += about(f"{sensor} {'xyz'[axis]}", (reason,))
    # below, a Gauss-Markov process for the filter represents the bias instability
    spec = SensorSpec(**{key: _values(models, name) for name, key in KEYS.items() if key != "bias_instability"})
    missing = [] if spec.random_walk.any() else ["random_walk"]
    if not instability.any():
        return spec, [*missing, "bias_instability", "correlation_time"], notes
    time = math.exp(float(np.mean(np.log(times))))
    notes.append(Finding.of(Code.ALLAN_ONE_TIME, subject=sensor, correlation_time_s=time, axes_s=tuple(times)))
    return replace(spec, bias_instability=instability, correlation_time=time), missing, notes


def _process(allan: AllanDeviation, column: int, model: NoiseModel) -> tuple[float, float, Finding]:
    """Compute sd and correlation time [s] of the Gauss-Markov process for the bias instability, with the reason."""
    if "GM" in model.coefficients:
        time = model.correlation_time
        return (model.coefficients["GM"].value, time, Finding.of(Code.ALLAN_BIAS_PROCESS, correlation_time_s=time))
    floor = floor_of(allan, column, model)
    if "B" in model.coefficients:
        sd = max(noise.B_FACTOR * model.coefficients["B"].value, floor.value) / PEAK
        return sd, floor.tau / PEAK_TIME, Finding.of(Code.ALLAN_BIAS_FLOOR, tau_s=floor.tau)
    if "K" in model.coefficients:
        return 0.0, math.inf, Finding.of(Code.ALLAN_BIAS_NONE)
    return floor.value / PEAK, floor.tau / PEAK_TIME, Finding.of(Code.ALLAN_BIAS_BOUND, tau_s=floor.tau)


def _values(models: tuple[NoiseModel | None, ...], name: str) -> FloatArray:
    """Return a coefficient of three axes, zero if absent."""
    return np.array([m.coefficients[name].value if m is not None and name in m.coefficients else 0.0 for m in models])


def temperature_correlation(values: FloatArray, temperature: FloatArray) -> FloatArray:
    """Compute the correlation of each column with temperature, over means of sixty equal parts of the record.

    `values` (n, c). `temperature` (n,): [deg C]. Returns (c,): zero for a constant column.
    """
    bins = 60
    length = len(values) // bins
    means = np.column_stack([values, temperature])[: bins * length].reshape(bins, length, -1).mean(axis=1)
    means -= means.mean(axis=0)
    norm = np.linalg.norm(means, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = means[:, :-1].T @ means[:, -1] / (norm[:-1] * norm[-1])
    return np.asarray(np.nan_to_num(correlation))


COARSE = 0.5  # larger resolution steps, relative to the sd of the samples, are reported
MISFIT = 0.1  # larger relative misfits of the Allan variance are reported
WARMING = 1.0  # larger temperature changes are reported [deg C]
TURNS, PUSHES = 3.0 * DEG, 0.5  # larger changes of the mean over a second are motion, not drift [rad/s], [m/s^2]
FOLLOWS = 0.5  # larger correlations with temperature are reported


@dataclass(frozen=True, slots=True)
class SignalNoise:
    """Noise of evenly sampled signals."""

    allan: AllanDeviation  # a column for each signal
    models: tuple[NoiseModel | None, ...]  # one per signal, at the times of `allan`; None for a constant signal
    # input of the model fit: deviations without the sinusoids, at default averaging times
    fitted: AllanDeviation


@dataclass(frozen=True, slots=True)
class StaticNoise:
    """Noise of the six axes of an IMU at rest."""

    allan: AllanDeviation  # columns gyro x, y, z, accelerometer x, y, z
    models: tuple[NoiseModel | None, ...]  # one per axis; None for an axis without any noise
    floors: tuple[Floor | None, ...]  # one per axis; None for an axis without any noise
    spec: ImuSpec  # for filters and simulations
    notes: tuple[Finding, ...]  # findings on the origin of the figures of `spec`
    warnings: tuple[Finding, ...]  # possible problems of the record or the models


def signal_noise(
    values: FloatArray,
    interval: float,
    taus: Sequence[float] | Literal["log", "octave"] = "log",
    *,
    workers: int | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> SignalNoise:
    """Compute Allan deviations and noise coefficients of signals.

    `values` (n, c): at even steps, a column for each signal, such as rates [rad/s] or specific forces [m/s^2].
    `interval`: step [s]. `taus`: averaging times [s], see `averaging_factors`.
    Raises: ConfigError: averaging times that are too long for the signals.
    """
    factors, default = (
        noise.averaging_factors(len(values), interval, taus),
        noise.averaging_factors(len(values), interval),
    )
    allan = noise.allan_deviation(values, interval, factors, workers)
    fitted = allan if np.array_equal(default, factors) else noise.allan_deviation(values, interval, default, workers)
    constant = np.ptp(values, axis=0) == 0.0
    sinusoids = [() if silent else _seen(values[:, i], fitted, i) for i, silent in enumerate(constant)]
    fitted = _without(values, sinusoids, fitted, workers)
    models: list[NoiseModel | None] = []
    for column, silent in enumerate(constant):
        progress(column / values.shape[1])
        model = None if silent else replace(noise.fit_noise(fitted, column), sinusoids=sinusoids[column])
        models.append(None if model is None else evaluated(model, allan, column))
    return SignalNoise(allan, tuple(models), fitted)


def _seen(values: FloatArray, allan: AllanDeviation, column: int) -> tuple[Sinusoid, ...]:
    """Find the sinusoids of a signal that noticeably affect its Allan deviation."""
    variance = noise.SEEN * allan.deviation[:, column] ** 2
    sinusoids = noise.find_sinusoids(values, allan.interval)
    return tuple(line for line in sinusoids if np.any(line.variance(allan.tau, allan.interval) > variance))


def _without(
    values: FloatArray, lines: Sequence[tuple[Sinusoid, ...]], allan: AllanDeviation, workers: int | None
) -> AllanDeviation:
    """Compute Allan deviations after removal of each signal's sinusoids."""
    affected = [column for column, sinusoids in enumerate(lines) if sinusoids]
    if not affected:
        return allan
    cleaned, time = values[:, affected], np.arange(len(values), dtype=np.float64) * allan.interval
    for k, column in enumerate(affected):
        for line in lines[column]:
            cleaned[:, k] -= line.at(time)
    deviation = allan.deviation.copy()
    deviation[:, affected] = noise.allan_deviation(cleaned, allan.interval, allan.factors, workers).deviation
    return replace(allan, deviation=deviation)


def static_noise(
    imu: ImuData,
    taus: Sequence[float] | Literal["log", "octave"] = "log",
    *,
    name: str = "static record",
    source: str = "",
    workers: int | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> StaticNoise:
    """Analyse the noise of a stationary record.

    Raises: InputError: the record is too short, or not stationary; ConfigError: averaging times that are too long.
    """
    values = np.hstack([imu.gyro, imu.accel])
    absent: BoolArray = np.asarray(np.isnan(values).all(axis=0))  # sensors absent from the record
    present = np.flatnonzero(~absent)
    # for each axis: itself, or the first present axis of the same triad
    stand_in = [next((k for k in (i, *present) if not absent[k] and k // 3 == i // 3), i) for i in range(6)]
    still, filled = (  # absent sensors replaced by zeros, and by the values of a present axis
        replace(imu, gyro=np.where(absent[:3], fill, imu.gyro), accel=np.where(absent[3:], fill, imu.accel))
        for fill in (0.0, values[:, present[:1]])
    )
    record = noise.even_record(still)
    _refuse_motion(record)
    found = signal_noise(record.values, record.interval, taus, workers=workers, progress=progress)
    at_fit = tuple(
        None if m is None else evaluated(replace(m, sinusoids=()), found.fitted, i) for i, m in enumerate(found.models)
    )
    floors = tuple(None if m is None else floor_of(found.fitted, i, m) for i, m in enumerate(at_fit))
    fitted = replace(found.fitted, deviation=found.fitted.deviation[:, stand_in])
    spec, notes = imu_spec(fitted, tuple(at_fit[i] for i in stand_in), name, source)
    missing = {axis: noise.AXES[i] for axis, i, lacking in zip(noise.AXES, stand_in, absent, strict=True) if lacking}
    replaced = [axis for axis, other in missing.items() if axis != other]
    others = {"others": tuple(dict.fromkeys(missing[axis] for axis in replaced))}
    notes = (*(each for each in notes if each.subject not in missing), *_of_axes(Code.ALLAN_ALIKE, replaced, **others))
    warnings = (*record.notes, *_of_record(filled, record), *_of_models(found.models, floors, record, missing))
    warnings = tuple(each for each in warnings if each.subject not in missing)
    measured = replace(found.allan, deviation=np.where(absent, np.nan, found.allan.deviation))
    return StaticNoise(measured, found.models, floors, spec, notes, warnings)


def _refuse_motion(record: EvenRecord) -> None:
    """Refuse a record with motion."""
    samples = max(1, round(1.0 / record.interval))
    count = len(record.values) // samples
    if count < 2:
        return
    seconds = record.values[: count * samples].reshape(count, samples, -1).mean(axis=1)
    # quantiles tolerate single knocks, which are visible in the figure
    span = np.quantile(seconds, 0.95, axis=0) - np.quantile(seconds, 0.05, axis=0)
    moved = [noise.AXES[i] for i in range(len(noise.AXES)) if span[i] > (TURNS if i < 3 else PUSHES)]
    if moved:
        raise InputError("lab.moving", sensors=tuple(moved), rate_rad_s=span[:3].max(), force_m_s2=span[3:].max())


def _of_record(imu: ImuData, record: EvenRecord) -> list[Finding]:
    """Report damaged samples, coarse resolution, temperature changes, and axes that correlate with temperature."""
    warnings = [
        Finding.of(Code.ALLAN_DAMAGED, subject=subject, count=count, what=code.value)
        for (code, subject), count in Counter((event.code, event.subject) for event in inspect(imu)[1]).items()
    ]
    steps, scatter = noise.smallest_step(record.values), record.values.std(axis=0)
    white = steps * math.sqrt(record.interval / 12.0)  # random walk from rounding samples to steps
    for columns, unit in ((range(3), "rad_sqrt_s"), (range(3, 6), "m_s_sqrt_s")):
        coarse = [i for i in columns if steps[i] > COARSE * scatter[i]]
        sizes = {f"random_walk_{unit}": white[coarse], "step_sigma": steps[coarse] / scatter[coarse]}
        warnings += _of_axes(Code.ALLAN_COARSE, [noise.AXES[i] for i in coarse], **sizes, limit_sigma=COARSE)
    changed = warming(imu.temperature, WARMING)
    if imu.temperature is not None and changed:
        inside = np.interp(record.start + record.interval * np.arange(len(record.values)), imu.time, imu.temperature)
        follows = temperature_correlation(record.values, inside)
        rows = np.flatnonzero(np.abs(follows) > FOLLOWS)
        correlated = {"correlation": follows[rows], "limit_correlation": FOLLOWS}
        warnings += [*changed, *_of_axes(Code.ALLAN_TEMPERATURE, [noise.AXES[i] for i in rows], **correlated)]
    return warnings


def _of_models(
    models: tuple[NoiseModel | None, ...], floors: tuple[Floor | None, ...], record: EvenRecord, missing: Container[str]
) -> list[Finding]:
    """Report poor models, unreached floors, silent axes, sinusoids and ramps; not of axes in `missing`."""
    short = [noise.AXES[i] for i, floor in enumerate(floors) if floor is not None and not floor.reached]
    known = {axis: model for axis, model in zip(noise.AXES, models, strict=True) if model is not None}
    misfit = {axis: 0.5 * model.misfit for axis, model in known.items() if model.misfit > MISFIT}
    ramps = [axis for axis, model in known.items() if "R" in model.coefficients]
    warnings = [
        *_of_axes(Code.ALLAN_SHORT, short, length_s=record.length),
        *_of_axes(Code.ALLAN_SILENT, [axis for axis in noise.AXES if axis not in known and axis not in missing]),
        *_of_axes(Code.ALLAN_MISFIT, misfit, share=tuple(misfit.values()), limit_share=0.5 * MISFIT),
    ]
    for axes, unit in ((noise.AXES[:3], "rad_s"), (noise.AXES[3:], "m_s2")):
        lines = {axis: known[axis].sinusoids[0] for axis in axes if axis in known and known[axis].sinusoids}
        strongest = {f"amplitude_{unit}": [line.amplitude for line in lines.values()]}
        frequency = [line.frequency for line in lines.values()]
        warnings += _of_axes(Code.ALLAN_SINUSOID, lines, **strongest, frequency_hz=frequency)
    return [*warnings, *_of_axes(Code.ALLAN_RAMP, ramps)]


def _of_axes(code: Code, axes: Iterable[str], **values: Any) -> tuple[Finding, ...]:
    """Make one finding for all affected axes, with their values in order; empty without axes."""
    names = ", ".join(axes)
    return (Finding.of(code, subject=names, **values),) if names else ()
