"""Gyro drift by its causes, rate, temperature and specific force, and its correction.

N = A + B W + c_T (T - 25 C) + c_g a for each axis: N is the output minus the true rate W, a the specific force along
the axis. The terms are bias, remaining scale factor error, and the sensitivities to temperature and to g.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.imu.higher_order import REFERENCE_TEMPERATURE, ErrorTerms
from insnav.imu.model import ImuErrors, correct
from insnav.lab.least_squares import Fit, coverage_factor, linear_fit
from insnav.types import BoolArray, FloatArray, ImuData
from insnav.units import DEG, G0

# least standard deviation of a cause, independent of the earlier causes, for its term
SHOWS = {"B": 1.0 * DEG, "c_T": 0.5, "c_g": 0.05 * G0}
_CAUSES = {"B": "rate", "c_T": "temperature", "c_g": "specific_force"}
_UNITS = {"B": "rad_s", "c_T": "k", "c_g": "m_s2"}
FEWEST = 100  # samples
PARTS = (12, 24, 48, 96, 192)  # of a record, whose means reveal correlation of the residuals
LARGEST_B = 0.5  # of a gyro in the unit of its header


@dataclass(frozen=True, slots=True)
class DriftRecord:
    """Gyro record with possible causes of drift."""

    name: str  # the file
    time: FloatArray  # (n,) even steps [s]
    axes: tuple[str, ...]  # letters of the gyros present
    gyro: Mapping[str, FloatArray]  # (n,) output, and true rate where it is known, by letter [rad/s]
    rate: Mapping[str, FloatArray]
    force: Mapping[str, FloatArray]  # (n,) specific force along the axis, where it is known [m/s^2]
    temperature: FloatArray | None  # (n,) [deg C]

    @property
    def interval(self) -> float:
        """Sampling interval [s]."""
        return float((self.time[-1] - self.time[0]) / (self.time.size - 1))

    def true_rate(self, axis: str) -> FloatArray:
        """True rate about an axis: at rest if nothing is known, (n,) [rad/s]."""
        return self.rate.get(axis, np.zeros(self.time.size))

    def at_rest(self) -> BoolArray:
        """Rows before anything turns, (n,)."""
        turning = np.zeros(self.time.size, dtype=np.bool_)
        for rate in self.rate.values():
            turning |= rate != 0.0
        return np.asarray(np.cumsum(turning) == 0)


@dataclass(frozen=True, slots=True)
class DriftModel:
    """Drift of one gyro."""

    axis: str  # its letter
    # fitted terms: A [rad/s], B [-], c_T [rad/s/K], c_g [rad/s/(m/s^2)], and their standard deviations, with the
    # correlation of the residuals (`variance_inflation`)
    value: Mapping[str, float]
    sd: Mapping[str, float]
    left_out: Mapping[str, Finding]  # terms that the record does not determine, with reason
    fit: Fit
    freedom: float  # degrees of freedom of these standard deviations

    def half_width(self, term: str) -> float:
        """Half width of the 95 % interval of a term."""
        return self.sd[term] * coverage_factor(self.freedom)


def drift_model(record: DriftRecord, axis: str) -> DriftModel:
    """Fit the drift of one gyro.

    `axis`: letter of the gyro. Raises: InputError: fewer than 100 samples.
    """
    if record.time.size < FEWEST:
        raise InputError("lab.drift_short", where=record.name, count=record.time.size, limit=FEWEST)
    columns = [np.ones(record.time.size)]
    causes = {
        "B": record.rate.get(axis),
        "c_T": None if record.temperature is None else record.temperature - REFERENCE_TEMPERATURE,
        "c_g": record.force.get(axis),
    }
    names = ["A"]
    left_out: dict[str, Finding] = {}
    for term, cause in causes.items():
        why = _left_out(term, cause, columns, f"gyro {axis}")
        if why is not None:
            left_out[term] = why
        elif cause is not None:
            names.append(term)
            columns.append(cause)
    drift = record.gyro[axis] - record.true_rate(axis)
    fit = linear_fit(np.column_stack(columns), drift, names, where=f"{record.name}, gyro {axis}")
    value = dict(zip(names, fit.value.tolist(), strict=True))
    if abs(value.get("B", 0.0)) > LARGEST_B:
        raise InputError("lab.rate_scale", where=record.name, sensor=f"gyro {axis}", ratio=1.0 + value["B"])
    inflation, freedom = variance_inflation(fit.residual, len(names))
    sd = fit.sd * np.sqrt(inflation)
    return DriftModel(axis, value, dict(zip(names, sd.tolist(), strict=True)), left_out, fit, freedom)


def _left_out(term: str, cause: FloatArray | None, columns: list[FloatArray], subject: str) -> Finding | None:
    """Find why a term cannot be separated from the earlier ones; None if it can."""
    if cause is None:
        return Finding.of(Code.DRIFT_NO_COLUMN, subject=subject, term=term, cause=_CAUSES[term])
    known = np.column_stack(columns)
    alone = np.std(cause - known @ np.linalg.lstsq(known, cause, rcond=None)[0])
    for code, spread in ((Code.DRIFT_CONSTANT, np.std(cause)), (Code.DRIFT_CONFOUNDED, alone)):
        if spread < SHOWS[term]:
            size: dict[str, Any] = {f"spread_{_UNITS[term]}": spread, f"limit_{_UNITS[term]}": SHOWS[term]}
            return Finding.of(code, subject=subject, **size, term=term, cause=_CAUSES[term])
    return None


def variance_inflation(residual: FloatArray, fitted: int) -> tuple[float, float]:
    """Compute the variance inflation of residual means by correlation.

    For independent samples, the variance of the means of equal parts times their length equals the sample variance. The
    largest ratio over several lengths up to a twelfth of the record counts. Correlation beyond the parts is not
    detected (method of batch means; J. M. Flegal and G. L. Jones, Annals of Statistics 38 (2010) 1034).

    `residual` (n,): of a fit. `fitted`: number of its parameters, which reduce the degrees of freedom of the means.
    Returns inflation of the variance of a mean, at least 1, and its degrees of freedom.
    """
    n = residual.size
    variance = float(residual @ residual) / max(1, n - fitted)
    best = (1.0, float(max(1, n - fitted)))
    for parts in PARTS:
        length = n // parts
        if length < 2 or not variance > 0.0:
            continue
        means = residual[: parts * length].reshape(parts, length).mean(axis=1)
        inflation = length * float(means @ means) / (parts - fitted) / variance
        if inflation > best[0]:
            best = inflation, float(parts - fitted)
    return best


def drift_errors(models: Mapping[str, DriftModel], name: str = "") -> ImuErrors:
    """Build errors for `insnav.imu.correct`: bias at 25 deg C, scale factor, sensitivities.

    `models`: by letter of the axis; other axes have no errors. `name`: of the sensor.
    """

    def three(term: str) -> FloatArray:
        return np.array([models[axis].value.get(term, 0.0) if axis in models else 0.0 for axis in "xyz"])

    terms = ErrorTerms(bias_slope=three("c_T"), g_sensitivity=np.diag(three("c_g")))
    return ImuErrors(gyro_bias=three("A"), gyro_matrix=np.diag(1.0 + three("B")), gyro_terms=terms, name=name)


def corrected_rates(record: DriftRecord, errors: ImuErrors) -> dict[str, FloatArray]:
    """Remove the modelled drift from the rates, by letter of the axis, (n,) each [rad/s].

    `errors`: from `drift_errors`.
    """
    nothing = np.zeros(record.time.size)
    gyro = np.column_stack([record.gyro.get(axis, nothing) for axis in "xyz"])
    force = np.column_stack([record.force.get(axis, nothing) for axis in "xyz"])
    found = correct(ImuData(record.time, gyro, force, temperature=record.temperature), errors).gyro
    return {axis: found[:, "xyz".index(axis)] for axis in record.axes}
