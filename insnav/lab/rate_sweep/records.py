"""Files of rate sweeps about three axes, one per axis or one with the rates about all, and tests of their use.

The tests concern the rates present, saturation of a gyro, and exchanged columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats.table import Table
from insnav.input.interpret.schema import schema
from insnav.lab.bench_data import BenchTable, Dwells, default_limit, dwell_warnings, read_bench, reduce_dwells
from insnav.lab.calibration import STANDARD, WRONG_UNIT, BenchOptions, about, common_unit, few
from insnav.lab.least_squares import Fit
from insnav.lab.single_axis.rate_table import FEWEST, Dropped
from insnav.types import BoolArray, FloatArray, IntArray
from insnav.units import UNITS

AXES = ("x", "y", "z")
USUAL_SAMPLES = 500  # in a dwell
SCHEMA = schema("rate_sweep")


@dataclass(frozen=True, slots=True)
class SweepRecord:
    """Sweeps reduced to one output per dwell."""

    tables: tuple[BenchTable, ...]  # as read
    dwells: Dwells  # of all: setting is the rate about x, y, z [rad/s], value the outputs of gyros x, y, z
    unit: str  # of the outputs; values are in volts or counts if this is such a unit, else in rad/s
    warnings: tuple[Finding, ...]

    @property
    def raw(self) -> bool:
        """True if the outputs are in volts or counts."""
        return UNITS[self.unit][0] == "signal"

    @property
    def name(self) -> str:
        """The files."""
        return ", ".join(table.name for table in self.tables)


def read_sweeps(paths: Sequence[str | Path | Table], how: BenchOptions = STANDARD) -> SweepRecord:
    """Read the sweeps.

    `paths`: three files with ``rate_deg_s``, the table turned about x, about y, about z; or one with ``rate_x_deg_s``,
    ``rate_y_deg_s``, ``rate_z_deg_s``. Each with ``gyro_x_deg_s`` to ``gyro_z_deg_s``, or in volts or counts.
    Successive rows of one rate are the samples of a dwell. `how`: columns and limit of spikes. Raises: InputError: the
    files cannot be used, or are neither one nor three.
    """
    if len(paths) not in (1, 3):
        raise InputError("lab.not_three_sweeps", count=len(paths))
    settings = ("rate",) if len(paths) == 3 else tuple(f"rate_{a}" for a in AXES)
    needed = (*settings, *(f"gyro_{a}" for a in AXES))
    raw_too = {f"gyro_{a}": f"raw_{a}" for a in AXES}
    tables = tuple(read_bench(path, SCHEMA, needed, columns=how.columns, alternatives=raw_too) for path in paths)
    unit = common_unit(
        [
            (key.replace("raw", "gyro").replace("_", " "), table.units[key])
            for table in tables
            for key in table.columns
            if key.startswith(("raw_", "gyro_"))
        ]
    )
    limit = how.spike_limit if how.spike_limit is not None else default_limit(unit)
    raw = UNITS[unit][0] == "signal"
    dwells: list[Dwells] = []
    warnings: list[Finding] = []
    for axis, table in enumerate(tables):
        if len(tables) == 3:
            rate = np.zeros((table.columns["rate"].size, 3))
            rate[:, axis] = table.columns["rate"]
        else:
            rate = table.stack(*settings)
        outputs = table.stack(*(f"{'raw' if raw else 'gyro'}_{a}" for a in AXES))
        in_si = limit if raw else limit * UNITS[unit][1]
        found = reduce_dwells(rate, outputs, in_si, table.get("time"), where=table.name)
        gyros = tuple(f"gyro {a}" for a in AXES)
        warnings += about(table.name, dwell_warnings(found, gyros, table.get("temperature")))
        if found.raw:
            warnings += few("samples of a dwell", int(found.count.min()), USUAL_SAMPLES, table.name)
        dwells.append(found)
    joined = (np.concatenate([getattr(each, part.name) for each in dwells]) for part in fields(Dwells))
    return SweepRecord(tables, Dwells(*joined), unit, tuple(warnings))


USUAL = 31  # rates about an axis, from which pieces are distinguishable from noise
FEWEST_FOR_MAP = 12  # with fewer rates no pieces are fitted
MOST_CROSSED = 0.3  # of the rate about another axis, over that about its own
FLAT = 0.5  # of its usual slope: below, a gyro is saturated
_SURE = 4.0  # standard deviations
_AT_STOP = 0.05  # of its usual growth: below, the output is at its limit


def check_rates(rate: FloatArray, own: Sequence[IntArray], where: str) -> tuple[Finding, ...]:
    """Refuse sweeps without an axis, and report unusual rates.

    `rate` (n, 3): rates of the table [rad/s]. `own` (k,): dwells about each axis alone.
    """
    warnings: list[Finding] = []
    for axis, rows in zip("xyz", own, strict=True):
        different, gyro = np.unique(rate[rows, "xyz".index(axis)]), f"gyro {axis}"
        if different.size < FEWEST:
            raise InputError(
                "lab.no_sweep" if different.size < 2 else "lab.short_sweep",
                where=where,
                axis=axis,
                count=different.size,
                limit=FEWEST,
            )
        if different[0] >= 0.0 or different[-1] <= 0.0:
            raise InputError(
                "lab.one_sided_sweep", where=where, axis=axis, low_rad_s=different[0], high_rad_s=different[-1]
            )
        if different.size < FEWEST_FOR_MAP:
            count, limit = different.size, FEWEST_FOR_MAP
            warnings.append(Finding.of(Code.BENCH_NO_MAP, subject=gyro, count=count, limit_count=limit))
        else:
            warnings += few("rates", different.size, USUAL, gyro)
        if -different[0] < 0.5 * different[-1] or different[-1] < -0.5 * different[0]:
            low, high = different[0], different[-1]
            warnings.append(Finding.of(Code.BENCH_ONE_SIDED, subject=gyro, low_rad_s=low, high_rad_s=high))
    return tuple(warnings)


def saturated(rate: FloatArray, output: FloatArray, sd: FloatArray) -> tuple[BoolArray, tuple[Dropped, ...]]:
    """Find the ends of a sweep where the output hardly grows with the rate.

    A non-linear gyro leaves a straight line long before its range ends. It is saturated from the rate at which its
    slope falls below half of the usual.

    `rate` (n,): about the gyro's own axis [deg/s]. `output` (n,): mean outputs. `sd` (n,): their standard deviations.
    Returns lost (n,).
    """
    different, which = np.unique(rate, return_inverse=True)
    count = np.bincount(which)
    mean = np.bincount(which, output) / count
    noise = np.sqrt(np.bincount(which, sd**2)) / count
    slope = np.diff(mean) / np.diff(different)
    usual = float(np.median(slope))
    if usual == 0.0:
        return np.zeros(rate.size, dtype=np.bool_), ()
    share = slope / usual
    unsure = np.hypot(noise[1:], noise[:-1]) / (np.diff(different) * abs(usual))
    flat = share + _SURE * unsure < FLAT
    lost = np.zeros(rate.size, dtype=np.bool_)
    dropped = []
    for sense in (1.0, -1.0):
        outer = different[1:] if sense > 0.0 else -different[:-1]  # of each step, the outer end in this sense
        ends = outer[flat & (outer > 0.0)]
        if ends.size == 0:
            continue
        first = float(ends.min())
        # the previous rate may already be at the limit, though the output still grew up to it
        at = int(np.flatnonzero(different == sense * first)[0])
        before = at - int(sense)
        if abs(mean[at] - mean[before]) < max(
            _AT_STOP * abs(usual * (different[at] - different[before])),
            _SURE * float(np.hypot(noise[at], noise[before])),
        ):
            first = sense * float(different[before])
        lost |= sense * rate >= first
        for value in different[sense * different >= first]:
            short = float(mean[different == value][0] - _extended(different, mean, sense * first, sense, float(value)))
            reason = Finding.of(Code.BENCH_RATE_FLAT, limit_share=FLAT)
            dropped.append(Dropped(float(value), short, float("nan"), reason))
    return lost, tuple(sorted(dropped, key=lambda item: item.rate))


def _extended(rate: FloatArray, output: FloatArray, first: float, sense: float, at: float) -> float:
    """Extrapolate the straight line through the inner rates to an outer rate."""
    inside = sense * rate < sense * first
    if np.count_nonzero(inside) < 2:
        return float("nan")
    return float(np.polyval(np.polyfit(rate[inside], output[inside], 1), at))


def refuse_crossed(fits: Sequence[Fit], raw: bool, where: str) -> None:
    """Refuse gyros that respond to another axis, or have another unit.

    `fits`: sensitivities to x, y, z and bias of each gyro. `raw`: whether the outputs are in volts or counts.
    """
    for i, (axis, fit) in enumerate(zip("xyz", fits, strict=True)):
        own, others = float(fit.value[i]), np.delete(fit.value[:3], i)
        if np.abs(others).max() > MOST_CROSSED * abs(own):
            raise InputError("lab.gyro_crossed", where=where, axis=axis, values=tuple(fit.value[:3].tolist()))
        if abs(own) < 5.0 * fit.sd[i]:
            raise InputError("lab.rate_ignored", where=where, sensor=f"gyro {axis}", scale=own, scale_sd=fit.sd[i])
        if not raw and abs(own - 1.0) > WRONG_UNIT:
            raise InputError(
                "lab.output_reversed" if own < 0.0 else "lab.output_unit", where=where, sensor=f"gyro {axis}", scale=own
            )


def shifted_zeros(error: FloatArray, own: Sequence[IntArray]) -> tuple[Finding, ...]:
    """Find gyros whose zero differs between the sweeps about the other two axes.

    `error` (n, 3): of the corrected rates [rad/s]; NaN where not known. `own` (k,): dwells about each axis alone.
    """
    warnings = []
    for i, axis in enumerate("xyz"):
        j, k = (a for a in range(3) if a != i)
        sides = [values[np.isfinite(values)] for values in (error[own[j], i], error[own[k], i])]
        if min(side.size for side in sides) < FEWEST:
            continue
        shift = float(sides[1].mean() - sides[0].mean())
        sd = float(np.hypot(*(side.std(ddof=1) / np.sqrt(side.size) for side in sides)))
        if abs(shift) > 5.0 * sd + 1e-9 * float(np.abs(error[np.isfinite(error)]).max()):
            size, first, second = abs(shift), "xyz"[j], "xyz"[k]
            warnings.append(
                Finding.of(Code.BENCH_ZERO_SHIFT, subject=f"gyro {axis}", shift_rad_s=size, first=first, second=second)
            )
    return tuple(warnings)
