"""From the noise a record shows to the figures a filter and a simulation need.

A filter cannot hold flicker noise, so a first-order Gauss-Markov process stands for the bias instability. Its Allan
deviation peaks at 1.89 correlation times with 0.617 of its standard deviation (0.437 q sqrt(T) with
sd = q sqrt(T / 2); IEEE Std 952-1997, annex C, exponentially correlated noise). Where the fit found such a process its
own figures are taken; where it found a flat floor the peak is put upon the floor. The floor itself is not written as
flicker noise as well: a simulation from the file would have the bias instability twice.

Quantisation and rate ramp go into the file for simulations; filters ignore them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from insnav.findings import Code, Finding
from insnav.imu.error_terms import terms_of
from insnav.imu.specification import ImuSpec, SensorSpec
from insnav.lab.common_findings import about
from insnav.lab.noise.allan import AllanDeviation
from insnav.lab.noise.noise_model import B_FACTOR, NoiseModel
from insnav.types import FloatArray

PEAK_TIME = 1.8926  # of the Gauss-Markov Allan deviation, in correlation times
PEAK = 0.61736  # its height, in standard deviations
KEYS = {term.allan: term.key for term in terms_of("gyro") if term.allan}  # of the IMU file, by coefficient
FLOOR_FREEDOM = 10.0  # degrees of freedom of a deviation that counts as the floor


@dataclass(frozen=True, slots=True)
class Floor:
    """Lowest point of an Allan deviation that is still well known."""

    value: float  # in the unit of the signal
    tau: float  # where [s]
    reached: bool  # whether the curve goes on at or above it for longer times, or was still falling


def floor_of(allan: AllanDeviation, column: int, model: NoiseModel) -> Floor:
    """Find the lowest point with at least ten degrees of freedom.

    column: which axis; model: for the degrees of freedom, and whether anything but falling terms was found.
    """
    known = np.flatnonzero(model.freedom >= FLOOR_FREEDOM)
    rows = known if known.size else np.arange(1)
    row = int(rows[np.argmin(allan.deviation[rows, column])])
    reached = any(name in model.coefficients for name in ("B", "GM", "K", "R"))
    return Floor(float(allan.deviation[row, column]), float(allan.tau[row]), reached)


def imu_spec(
    allan: AllanDeviation, models: tuple[NoiseModel | None, ...], name: str, source: str
) -> tuple[ImuSpec, tuple[Finding, ...]]:
    """Figures for a filter from the noise of six axes.

    allan: columns gyro x, y, z, accelerometer x, y, z; models: one for each; None for an axis without any noise;
    name, source: for the file. Returns spec: random walk, bias instability with its correlation time, rate random
    walk, and to simulate quantisation and rate ramp. Turn-on bias, scale factor and misalignment are absent: one
    record at rest does not show them; notes: how each figure came about.
    """
    notes: list[Finding] = []
    absent: list[str] = []
    sensors = []
    for first, sensor in ((0, "gyro"), (3, "accel")):
        spec, missing, how = _sensor(allan, models[first : first + 3], first, sensor)
        sensors.append(spec)
        notes += how
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
        sd, time, how = _process(allan, first + axis, model)
        instability[axis] = sd
        if sd > 0.0:
            times.append(time)
        notes += about(f"{sensor} {'xyz'[axis]}", (how,))
    # the in-run bias is a process for the filter, below
    spec = SensorSpec(**{key: _values(models, name) for name, key in KEYS.items() if key != "bias_instability"})
    missing = [] if spec.random_walk.any() else ["random_walk"]
    if not instability.any():
        return spec, [*missing, "bias_instability", "correlation_time"], notes
    time = math.exp(float(np.mean(np.log(times))))
    notes.append(Finding.of(Code.ALLAN_ONE_TIME, subject=sensor, correlation_time_s=time, axes_s=tuple(times)))
    return replace(spec, bias_instability=instability, correlation_time=time), missing, notes


def _process(allan: AllanDeviation, column: int, model: NoiseModel) -> tuple[float, float, Finding]:
    """Standard deviation and correlation time of the process that stands for the bias instability, and why."""
    if "GM" in model.coefficients:
        time = model.correlation_time
        return (model.coefficients["GM"].value, time, Finding.of(Code.ALLAN_BIAS_PROCESS, correlation_time_s=time))
    floor = floor_of(allan, column, model)
    if "B" in model.coefficients:
        sd = max(B_FACTOR * model.coefficients["B"].value, floor.value) / PEAK
        return sd, floor.tau / PEAK_TIME, Finding.of(Code.ALLAN_BIAS_FLOOR, tau_s=floor.tau)
    if "K" in model.coefficients:
        return 0.0, math.inf, Finding.of(Code.ALLAN_BIAS_NONE)
    return floor.value / PEAK, floor.tau / PEAK_TIME, Finding.of(Code.ALLAN_BIAS_BOUND, tau_s=floor.tau)


def _values(models: tuple[NoiseModel | None, ...], name: str) -> FloatArray:
    """A coefficient of three axes, zero where it was not found."""
    return np.array([m.coefficients[name].value if m is not None and name in m.coefficients else 0.0 for m in models])


def white_of_steps(step: float, interval: float) -> float:
    """Random walk that rounding samples to steps makes, ``step sqrt(dt / 12)`` [unit sqrt(s)].

    step: resolution of a sample; interval: sampling interval [s].
    """
    return step * math.sqrt(interval / 12.0)


def temperature_correlation(values: FloatArray, temperature: FloatArray) -> FloatArray:
    """Correlation of each column with temperature over means of sixty equal parts of the record.

    values (n, c); temperature (n,): [deg C]. Returns (c,): zero where nothing varies.
    """
    bins = 60
    length = len(values) // bins
    parts = np.column_stack([values, temperature])[: bins * length].reshape(bins, length, -1).mean(axis=1)
    parts -= parts.mean(axis=0)
    size = np.linalg.norm(parts, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = parts[:, :-1].T @ parts[:, -1] / (size[:-1] * size[-1])
    return np.asarray(np.nan_to_num(correlation))
