"""Calibration of accelerometers by tumbling, one after another: bias, scale factor, second order, cross-coupling."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from insnav.input.formats.table import Table
from insnav.input.interpret.schema import Quantity
from insnav.lab.calibration import BenchOptions, Calibration
from insnav.lab.single_axis.records import OUTPUT, Record, read_records, refuse_unit, triad_calibration
from insnav.lab.single_axis.tumble import USUAL, Tumble, calibrate_tumble
from insnav.units import DEG, G0

SCHEMA = (
    Quantity("angle", "angle_deg", "angle", "deg", ("angle", "theta", "position", "pitch")),
    Quantity("output", "output_v", "signal", "V", OUTPUT),
    Quantity("sensed", "output_m_s2", "acceleration", "m/s^2", (*OUTPUT, "accel")),
)


def read(files: Sequence[str | Path | Table], how: BenchOptions) -> tuple[Record, ...]:
    """Read the tumble tests of accelerometers x, y, z, or of one; see `read_records`."""
    return read_records(files, SCHEMA, how)


def fit(record: tuple[Record, ...], how: BenchOptions) -> Calibration[tuple[Record, ...], tuple[Tumble, ...]]:
    """Fit the model of accelerometers x, y, z, or of one for all; its K2 and K3 are parameters only."""
    found = tuple(calibrate_accel(item) for item in record)
    per = ("", "/g", "/g^2", "/g^2")
    return triad_calibration("accel", record, found, how.gravity, per, how, [tumble_warnings(item) for item in found])


def calibrate_accel(record: Record) -> Tumble:
    """Model of an accelerometer.

    Raises InputError: see `calibrate_tumble`; or a digital output in another unit than its column states.
    """
    found = calibrate_tumble(record.setting, record.output, where=record.table.name)
    refuse_unit(record, float(found.fit.value[1]) / G0)
    return found


def tumble_warnings(found: Tumble) -> tuple[str, ...]:
    """Say what is wrong with a tumble test that could still be used."""
    warnings = []
    if found.angle.size < USUAL:
        warnings.append(f"only {found.angle.size} positions; {USUAL}, every 30 deg, are usual")
    for row in found.suspicious:
        warnings.append(
            f"the position at {found.angle[row] / DEG:.4g} deg does not belong to the others: its residual is "
            f"{found.fit.residual[row]:.3g}, beyond what their scatter explains"
        )
    return tuple(warnings)
