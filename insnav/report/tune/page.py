"""Report of IMU noise from its drives."""

from __future__ import annotations

from insnav.fleet.tuning import Tuned
from insnav.imu.imu_file import to_toml
from insnav.report.page import DataFrame, Page, rows_frame
from insnav.report.run.quantities import noise_section
from insnav.report.tables import of_table
from insnav.result import Result
from insnav.units import UNITS


def page(result: Result[Tuned]) -> Page:
    """Lay out the noise of an IMU."""
    found = result.found
    summary = f"The log-likelihood is {found.gain:.0f} above the prior; drives: {found.drives}."
    return Page(f"Noise of an IMU: {found.spec.name}", (summary,), (noise_section(found),))


def texts(result: Result[Tuned]) -> dict[str, str]:
    """Return the IMU error specification as file text."""
    return {"imu.toml": to_toml(result.found.spec)}


def frame(result: Result[Tuned]) -> DataFrame:
    """Build a table of noise parameters, one row each, with prior and 95 % interval."""
    rows = []
    for each in result.found.figures:
        size = UNITS[each.unit][1] if each.unit else 1.0
        values = {name: getattr(each, name) / size for name in ("prior", "value", "low", "high")}
        rows.append(of_table("tune.figure", each, **values))
    return rows_frame(rows)
