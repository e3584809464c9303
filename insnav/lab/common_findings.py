"""What several methods of the bench can find wrong with a measurement."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from insnav.findings import Code, Finding
from insnav.lab.least_squares import Fit
from insnav.lab.multi_position.triad import Triad
from insnav.types import FloatArray

BADLY_CONDITIONED = 30.0  # condition number beyond which parameters are hardly separated


def about(name: str, findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Add the name of a sensor or a file to the subjects of findings: ``gyro x (rates.csv)``."""
    return tuple(replace(each, subject=f"{each.subject} ({name})" if each.subject else name) for each in findings)


def badly_conditioned(fits: Mapping[str, Fit] | Mapping[str, Triad]) -> tuple[Finding, ...]:
    """Find fits, by their sensors, that hardly separate their parameters."""
    return tuple(
        Finding.of(Code.BENCH_CONDITION, subject=name, condition=fit.condition, limit=BADLY_CONDITIONED)
        for name, fit in fits.items()
        if fit.condition > BADLY_CONDITIONED
    )


def few(what: str, count: int, usual: int, subject: str = "") -> tuple[Finding, ...]:
    """Find whether there are fewer of something, a word of the catalogue such as ``rates``, than is usual."""
    found = Finding.of(Code.BENCH_FEW, subject=subject, count=count, limit_count=usual, what=what)
    return (found,) if count < usual else ()


def outlier(fit: Fit, row: int, angle_rad: float = math.nan) -> Finding:
    """Find a row of a fit that does not belong to the others, as `insnav.lab.least_squares.outliers` has them."""
    size = abs(float(fit.residual[row])) / fit.sigma
    return Finding.of(Code.BENCH_OUTLIER, residual_sigma=size, row=row + 1, angle_rad=angle_rad)


def warming(temperature: FloatArray | None, limit: float) -> tuple[Finding, ...]:
    """Find whether the temperature (n,) [deg C] changed by more than a limit [K]."""
    if temperature is None or np.ptp(temperature) <= limit:
        return ()
    low, high = np.min(temperature), np.max(temperature)
    return (Finding.of(Code.BENCH_TEMPERATURE, change_k=high - low, limit_k=limit, low_c=low, high_c=high),)
