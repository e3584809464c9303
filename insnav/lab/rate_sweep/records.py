"""Files of rate sweeps about three axes: one for each axis, or one with the rates about all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insnav.exceptions import InputError
from insnav.findings import Finding
from insnav.input.formats.table import Table
from insnav.input.interpret.schema import schema
from insnav.lab.bench_data.bench_tables import BenchTable, read_bench
from insnav.lab.bench_data.dwells import Dwells, default_limit, dwell_warnings, reduce_dwells
from insnav.lab.calibration import common_unit
from insnav.lab.common_findings import about, few
from insnav.types import FloatArray
from insnav.units import UNITS

AXES = ("x", "y", "z")
USUAL_SAMPLES = 500  # in a dwell
SCHEMA = schema("rate_sweep")


@dataclass(frozen=True, slots=True)
class SweepRecord:
    """Sweeps reduced to one output a dwell."""

    tables: tuple[BenchTable, ...]  # as read
    # of each file: setting is the rate about x, y, z [rad/s], value the outputs of gyros x, y, z
    dwells: tuple[Dwells, ...]
    unit: str  # of the outputs; values are in it if it is one of volts or counts, else in rad/s
    warnings: tuple[Finding, ...]

    @property
    def raw(self) -> bool:
        """Whether the outputs are in volts or counts."""
        return UNITS[self.unit][0] == "signal"

    @property
    def rate(self) -> FloatArray:
        """Rate of the table in each dwell, (n, 3) [rad/s]."""
        return np.concatenate([item.setting for item in self.dwells])

    @property
    def output(self) -> FloatArray:
        """Mean output of each gyro, (n, 3)."""
        return np.concatenate([item.value for item in self.dwells])

    @property
    def sd(self) -> FloatArray:
        """Standard deviation of these means, (n, 3)."""
        return np.concatenate([item.sd for item in self.dwells])

    @property
    def name(self) -> str:
        """The files."""
        return ", ".join(table.name for table in self.tables)


def read_sweeps(
    paths: Sequence[str | Path | Table], *, columns: Mapping[str, str] | None = None, spike_limit: float | None = None
) -> SweepRecord:
    """Read the sweeps.

    paths: three files with ``rate_deg_s``, the table turned about x, about y, about z; or one with
    ``rate_x_deg_s``, ``rate_y_deg_s``, ``rate_z_deg_s``. Each with ``gyro_x_deg_s`` to ``gyro_z_deg_s``, or in
    volts or counts. Successive rows of one rate are the samples of a dwell; columns: as in `read_bench`;
    spike_limit: samples further than this from a polynomial through their dwell are dropped, in the unit of the
    outputs; default 0.005 V, and for other units than volts none are. Raises InputError: the files cannot be used,
    or are neither one nor three.
    """
    if len(paths) not in (1, 3):
        raise InputError("lab.not_three_sweeps", count=len(paths))
    settings = ("rate",) if len(paths) == 3 else tuple(f"rate_{a}" for a in AXES)
    needed = (*settings, *(f"gyro_{a}" for a in AXES))
    raw_too = {f"gyro_{a}": f"raw_{a}" for a in AXES}
    tables = tuple(read_bench(path, SCHEMA, needed, columns=columns, alternatives=raw_too) for path in paths)
    unit = common_unit(
        [
            (key.replace("raw", "gyro").replace("_", " "), table.units[key])
            for table in tables
            for key in table.columns
            if key.startswith(("raw_", "gyro_"))
        ]
    )
    limit = spike_limit if spike_limit is not None else default_limit(unit)
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
    return SweepRecord(tables, tuple(dwells), unit, tuple(warnings))
