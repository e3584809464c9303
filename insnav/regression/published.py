"""Published outage results, simulations of the same tests, and the ratio of field to simulation.

A replica has only the published figures of the IMU, a motion of the same kind, RTK fixes, and the published statistic.
Field factor: recorded over predicted error. It includes the effect of unpublished figures.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import scipy

from insnav.config_file import Table, read_toml, scalar, validate
from insnav.imu import load_imu
from insnav.sample_statistics import rms
from insnav.session.simulation import simulate
from insnav.types import FloatArray

SEEDS = 3  # drives per replica
FIRST, SPACING = 120.0, 15.0  # of the outages in a drive [s]
Statistic = Literal["RMS of maxima", "RMS at the end", "mean at the end", "maximum"]


class Case(Table):
    """Published result."""

    source: str
    where: str
    imu: str
    profile: str
    length: Annotated[float, scalar("time")]
    statistic: Statistic
    value: Annotated[float, scalar("length")]
    reason: str  # reason for the ratio
    aiding: bool = False  # NHC and ZUPT in the outage
    independent: bool = True  # from a separate test
    comparable: bool = True  # the replica has all aiding of the test


class _File(Table):
    case: list[Case]


@dataclass(frozen=True, slots=True)
class Compared:
    """Published result and its replica."""

    case: Case
    missing: tuple[str, ...]  # usual IMU figures that are unpublished, and absent in the replica
    replica: float  # the same statistic [m]
    interval: tuple[float, float]  # 95 % of an RMS of as many outages [m]
    outages: int

    @property
    def ratio(self) -> float:
        """Ratio of published to simulated error."""
        return self.case.value / self.replica


@dataclass(frozen=True, slots=True)
class FieldFactor:
    """Ratio of field errors to predicted errors."""

    ratios: Mapping[str, float]  # of every recorded drive and every independent published case
    typical: float  # geometric mean
    interval: tuple[float, float]  # its 95 % interval
    span: tuple[float, float]  # 95 % range of further drives' ratios


def read_cases() -> list[Case]:
    """Read the published results."""
    path = Path(__file__).with_suffix(".toml")
    return validate(_File, read_toml(path), str(path)).case


def compare_published(
    cases: Sequence[Case], seeds: int = SEEDS, progress: Callable[[float], None] | None = None
) -> list[Compared]:
    """Simulate every case; cases of one test share a simulation.

    `seeds`: drives of a replica. `progress`: called with the fraction done.
    """
    made: dict[tuple[str, str, float, bool], list[FloatArray]] = {}
    tests = list(dict.fromkeys(_test(case) for case in cases))
    for number, test in enumerate(tests):
        made[test] = errors_in_outages(*test, seeds=seeds)
        if progress is not None:
            progress((number + 1) / len(tests))
    return [_compared(case, made[_test(case)]) for case in cases]


def _test(case: Case) -> tuple[str, str, float, bool]:
    return case.imu, case.profile, case.length, case.aiding


def errors_in_outages(imu: str, profile: str, length: float, aiding: bool, *, seeds: int) -> list[FloatArray]:
    """Simulate horizontal errors in outages, one array per outage [m]."""
    spec = load_imu(imu)
    found = []
    for seed in range(1, seeds + 1):
        drive = simulate(profile, imu=spec, gps="rtk", seed=seed)
        study = drive.outage(
            lengths=(length,), first=FIRST, spacing=SPACING, aiding="on" if aiding else "off", workers=1
        )
        found += [np.hypot(window.error[:, 0], window.error[:, 1]) for window in study.found.windows]
    return found


def statistic(kind: Statistic, errors: Sequence[FloatArray]) -> float:
    """Summarise horizontal outage errors by the statistic of a paper [m]."""
    ends, largest = np.array([each[-1] for each in errors]), np.array([each.max() for each in errors])
    if kind == "RMS of maxima":
        return float(rms(largest))
    if kind == "mean at the end":
        return float(ends.mean())
    return float(ends.max()) if kind == "maximum" else float(rms(ends))


def _compared(case: Case, errors: Sequence[FloatArray]) -> Compared:
    value = statistic(case.statistic, errors)
    # outages of one drive overlap: the number that fits without overlap is independent
    count = max(2.0, len(errors) * min(1.0, SPACING / case.length))
    spread = 1.96 / math.sqrt(2.0 * count)
    interval = (value * math.exp(-spread), value * math.exp(spread))
    missing = tuple(key for key in load_imu(case.imu).absent if not key.endswith("correlation_time"))
    return Compared(case, missing, value, interval, len(errors))


def recorded_ratios(growth: Mapping[str, FloatArray]) -> dict[str, float]:
    """Compute the ratio of recorded to predicted horizontal error after a minute, by drive.

    `growth`: of each drive ``(n, 3)`` at increasing times, the last a minute: number of windows, sums of squared errors
    and of predicted variances [m^2].
    """
    return {
        name: math.sqrt(float(rows[-1, 1] / rows[-1, 2]))
        for name, rows in growth.items()
        if rows[-1, 0] > 0 and rows[-1, 2] > 0.0
    }


def field_factor(compared: Sequence[Compared], recorded: Mapping[str, float]) -> FieldFactor:
    """Compute the field factor: geometric mean, its interval and the range of further ratios, by Student's t."""
    ratios = dict(recorded)
    ratios |= {each.case.source: each.ratio for each in compared if each.case.independent and each.case.comparable}
    logs = np.log(list(ratios.values()))
    n = len(logs)
    mean, sd = float(logs.mean()), float(logs.std(ddof=1))
    quantile = float(scipy.special.stdtrit(n - 1, 0.975))
    own, further = quantile * sd / math.sqrt(n), quantile * sd * math.sqrt(1.0 + 1.0 / n)
    interval, span = ((math.exp(mean - half), math.exp(mean + half)) for half in (own, further))
    return FieldFactor(ratios, math.exp(mean), interval, span)
