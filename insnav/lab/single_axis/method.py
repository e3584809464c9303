"""Benches with one sensor at a time: what their files hold, and the calibration file they make.

The output is in volts, counts, or already in the unit of what is sensed. Volts and counts become a line in the
calibration file (`insnav.imu.raw_outputs`), anything else a bias and a scale factor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from insnav.exceptions import InputError
from insnav.imu.model import ImuErrors
from insnav.imu.raw_outputs import RawScale
from insnav.input.interpret.schema import Quantity
from insnav.lab.bench_data.bench_tables import BenchTable, read_bench
from insnav.lab.bench_data.dwells import Dwells, default_limit, dwell_warnings, reduce_dwells
from insnav.lab.navigation_impact import Calibrated
from insnav.lab.single_axis.rate_table import RateTable, calibrate_rate_table
from insnav.lab.single_axis.tumble import USUAL, Tumble, calibrate_tumble
from insnav.types import FloatArray
from insnav.units import DEG, G0, UNITS

WRONG_UNIT = 0.25  # scale factor error that no sensor with a digital output has
USUAL_RATES = 10  # ± 10, 20, 40, 60, 80 deg/s
_OUTPUT = ("output", "voltage", "volts", "u", "signal", "measured")
RATE_TABLE = (
    Quantity("rate", "rate_deg_s", "rate", "deg/s", ("rate", "tablerate", "angularrate", "omega", "w")),
    Quantity("output", "output_v", "signal", "V", _OUTPUT),
    Quantity("sensed", "output_deg_s", "rate", "deg/s", (*_OUTPUT, "gyro")),
)
TUMBLE = (
    Quantity("angle", "angle_deg", "angle", "deg", ("angle", "theta", "position", "pitch")),
    Quantity("output", "output_v", "signal", "V", _OUTPUT),
    Quantity("sensed", "output_m_s2", "acceleration", "m/s^2", (*_OUTPUT, "accel")),
)


@dataclass(frozen=True, slots=True)
class Record:
    """One sensor's bench file, reduced to one output a dwell.

    Attributes
    ----------
    table : BenchTable
        As read.
    dwells : Dwells
        Setting [rad/s] or [rad], output in `unit`.
    unit : str
        Of the output.
    warnings : tuple of str
    """

    table: BenchTable
    dwells: Dwells
    unit: str
    warnings: tuple[str, ...]

    @property
    def setting(self) -> FloatArray:
        """Rate [rad/s] or angle [rad] of each dwell, (n,)."""
        return self.dwells.setting[:, 0]

    @property
    def output(self) -> FloatArray:
        """Output of each dwell, (n,)."""
        return self.dwells.value[:, 0]

    @property
    def raw(self) -> bool:
        """Whether the output is in volts or counts."""
        return UNITS[self.unit][0] == "signal"


def read_record(
    path: str | Path,
    schema: Sequence[Quantity],
    *,
    columns: Mapping[str, str] | None = None,
    spike_limit: float | None = None,
) -> Record:
    """Read the file of one sensor.

    Parameters
    ----------
    path : str or Path
        Columns of setting and output; several successive rows of one setting are the samples of a dwell.
    schema : sequence of Quantity
        `RATE_TABLE` or `TUMBLE`.
    columns : mapping of str to str, optional
        As in `read_bench`.
    spike_limit : float, optional
        Samples further than this from a polynomial through their dwell are dropped, in the unit of the output;
        default 0.005 V, and for other units than volts none are.

    Raises
    ------
    InputError
        The file cannot be used.
    """
    setting = schema[0].key
    table = read_bench(path, schema, (setting, "output"), columns=columns, alternatives={"output": "sensed"})
    key = "output" if "output" in table.columns else "sensed"
    unit = table.units[key] if key == "output" else schema[2].unit
    values = table.columns[key] / (1.0 if key == "output" else UNITS[unit][1])
    limit = spike_limit if spike_limit is not None else default_limit(unit)
    dwells = reduce_dwells(table.columns[setting][:, None], values[:, None], limit, table.get("time"), where=table.name)
    said = dwell_warnings(dwells, ("output",), table.get("temperature"))
    return Record(table, dwells, unit, said)


def calibrate_gyro(record: Record, keep: tuple[float, float] | None = None) -> RateTable:
    """Zero and scale factor of a gyro; rates in deg/s as rate tables show them.

    Parameters
    ----------
    record : Record
        With `RATE_TABLE`.
    keep : (float, float), optional
        Smallest and largest rate to use [deg/s].

    Raises
    ------
    InputError
        See `calibrate_rate_table`; or a digital output in another unit than its column says.
    """
    # the table's rates are round numbers in deg/s: keep them so
    rate = np.round(record.setting / DEG, 9)
    found = calibrate_rate_table(rate, record.output, keep, where=record.table.name)
    _refuse_unit(record, float(found.fit.value[1]))
    return found


def calibrate_accel(record: Record) -> Tumble:
    """Model of an accelerometer.

    Parameters
    ----------
    record : Record
        With `TUMBLE`.

    Raises
    ------
    InputError
        See `calibrate_tumble`; or a digital output in another unit than its column says.
    """
    found = calibrate_tumble(record.setting, record.output, where=record.table.name)
    _refuse_unit(record, float(found.fit.value[1]) / G0)
    return found


def _refuse_unit(record: Record, scale: float) -> None:
    """Refuse a digital output that is not in the unit of its column; volts and counts may have any scale."""
    if not record.raw and abs(scale - 1.0) > WRONG_UNIT:
        raise InputError(
            "the output is not in the unit of its column",
            where=record.table.name,
            why=f"its scale factor comes out as {scale:.4g}, for {record.unit}",
            fix="turn the sign of the table or of the sensor" if scale < 0.0 else "check the units in the headers",
        )


def rate_table_warnings(found: RateTable) -> tuple[str, ...]:
    """Say what is wrong with a rate table that could still be used."""
    said = []
    used = np.unique(found.rate[found.used])
    left = [item for item in found.dropped if np.isfinite(item.limit) and not item.reason.startswith("outside")]
    if left:
        said.append(
            f"{len(left)} of {found.rate.size} rates were left out: the output has left the straight line there"
        )
    if used.size < USUAL_RATES:
        said.append(f"only {used.size} different rates; {USUAL_RATES} or more are usual")
    if used[0] >= 0.0 or used[-1] <= 0.0:
        said.append("one sense of rotation only: a scale factor that differs between the senses is in the zero")
    return tuple(said)


def tumble_warnings(found: Tumble) -> tuple[str, ...]:
    """Say what is wrong with a tumble test that could still be used."""
    said = []
    if found.angle.size < USUAL:
        said.append(f"only {found.angle.size} positions; {USUAL}, every 30 deg, are usual")
    for row in found.suspicious:
        said.append(
            f"the position at {found.angle[row] / DEG:.4g} deg does not belong to the others: its residual is "
            f"{found.fit.residual[row]:.3g}, beyond what their scatter explains"
        )
    return tuple(said)


def gyro_errors(records: Sequence[Record], found: Sequence[RateTable], name: str = "") -> ImuErrors:
    """Make the calibration of gyros x, y, z; one gyro stands for all three.

    Parameters
    ----------
    records : sequence of Record
        One or three.
    found : sequence of RateTable
        Of the same.
    name : str
        What was calibrated.

    Raises
    ------
    InputError
        The three outputs have different units, or there are not one or three.
    """
    unit = _common_unit(records)
    zero = _three([item.fit.value[0] for item in found])
    scale = _three([item.fit.value[1] for item in found])  # unit per deg/s
    if records[0].raw:
        return ImuErrors(gyro_raw=RawScale(unit, zero, scale / DEG), name=name)
    return ImuErrors(gyro_bias=zero * DEG, gyro_matrix=np.diag(scale), name=name)


def accel_errors(records: Sequence[Record], found: Sequence[Tumble], gravity: float, name: str = "") -> ImuErrors:
    """Make the calibration of accelerometers x, y, z; one stands for all three.

    Parameters
    ----------
    records : sequence of Record
        One or three.
    found : sequence of Tumble
        Of the same.
    gravity : float
        Local gravity [m/s^2].
    name : str
        What was calibrated.

    Raises
    ------
    InputError
        The three outputs have different units, or there are not one or three.
    """
    unit = _common_unit(records)
    zero = _three([item.fit.value[0] for item in found])
    scale = _three([item.fit.value[1] for item in found]) / gravity
    if records[0].raw:
        return ImuErrors(accel_raw=RawScale(unit, zero, scale), name=name)
    return ImuErrors(accel_bias=zero, accel_matrix=np.diag(scale), name=name)


def carried_over(new: ImuErrors, other: ImuErrors, kept: str) -> ImuErrors:
    """Put the other triad of an earlier calibration beside a new one.

    Parameters
    ----------
    new, other : ImuErrors
        The new and the earlier calibration.
    kept : {"gyro", "accel"}
        What to take from the earlier one.
    """
    fields = [field for field in new.__dataclass_fields__ if field.startswith(f"{kept}_")]
    return replace(new, **{field: getattr(other, field) for field in fields})


def _three(values: Sequence[float]) -> FloatArray:
    return np.array(values if len(values) == 3 else [values[0]] * 3)


def _common_unit(records: Sequence[Record]) -> str:
    if len(records) not in (1, 3):
        raise InputError(
            f"{len(records)} sensors are no triad",
            why="a calibration is of x, y and z",
            fix="give the files of x, y, z in this order, or one file that stands for all",
        )
    units = {item.unit for item in records}
    if len(units) > 1:
        raise InputError(
            "the sensors have outputs in different units",
            why=", ".join(f"{item.table.name}: {item.unit}" for item in records),
            fix="bring them to one unit",
        )
    return records[0].unit


def single_uncertainty(errors: ImuErrors, found: Sequence[RateTable] | Sequence[Tumble], factor: float) -> Calibrated:
    """Put the uncertainty of zero and scale factor beside a calibration.

    Parameters
    ----------
    errors : ImuErrors
        From `gyro_errors` or `accel_errors`.
    found : sequence of RateTable or of Tumble
        One or three.
    factor : float
        Input in SI units of one unit of the fit: rad/s of 1 deg/s, m/s^2 of 1 g.
    """
    scale = _three([item.fit.value[1] for item in found])
    bias_sd = _three([item.fit.sd[0] for item in found]) / np.abs(scale) * factor
    matrix_sd = np.diag(_three([item.fit.sd[1] for item in found]) / np.abs(scale))
    if isinstance(found[0], RateTable):
        return Calibrated(errors, gyro_bias_sd=bias_sd, gyro_matrix_sd=matrix_sd)
    return Calibrated(errors, accel_bias_sd=bias_sd, accel_matrix_sd=matrix_sd)
