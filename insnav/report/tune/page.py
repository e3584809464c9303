"""The noise of an IMU from its drives, as a page."""

from __future__ import annotations

from insnav.fleet.tuning import Tuned
from insnav.imu.imu_file import to_toml
from insnav.output.folder import RunFolder
from insnav.output.solution_tables import TableFormat
from insnav.quantity import Quantity
from insnav.report.page import DataFrame, Page, rows_frame
from insnav.report.run.quantities import noise_section
from insnav.result import Result
from insnav.units import UNITS


def page(result: Result[Tuned]) -> Page:
    """Lay out the noise of an IMU."""
    found = result.found
    summary = f"The log-likelihood is {found.gain:.0f} above that of the prior; drives: {found.drives}."
    return Page(f"Noise of an IMU: {found.spec.name}", (summary,), (noise_section(found),))


def write_files(result: Result[Tuned], folder: RunFolder, table_format: TableFormat) -> None:
    """Write the IMU error specification."""
    folder.path("imu.toml").write_text(to_toml(result.found.spec), encoding="utf-8", newline="\n")


def frame(result: Result[Tuned]) -> DataFrame:
    """Give the noise figures as a table, one row a figure, with its prior and the interval of 95 %."""
    sizes = ((each, UNITS[each.unit][1] if each.unit else 1.0) for each in result.found.figures)
    return rows_frame(
        (
            Quantity("figure", each.key),
            Quantity("unit", each.unit),
            *(Quantity(name, getattr(each, name) / size) for name in ("prior", "value", "low", "high")),
            Quantity("observable", each.observable),
        )
        for each, size in sizes
    )
