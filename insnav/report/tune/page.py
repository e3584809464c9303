"""Report of the noise parameters of an IMU, estimated from its drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.fleet.tuning import Tuned
from insnav.imu.imu_file import to_toml
from insnav.report.page import DataFrame, Page, drawn, rows_frame
from insnav.report.panels import Curve, bars, row_panel
from insnav.report.run.quantities import noise_section
from insnav.report.style import BLUE, VERMILLION
from insnav.report.tables import of_table
from insnav.result import Result
from insnav.units import UNITS


def page(result: Result[Tuned]) -> Page:
    """Lay out the noise parameters of an IMU: a table, and a figure of each relative to its prior."""
    found = result.found
    summary = f"The log-likelihood is {found.gain:.0f} above the prior; drives: {found.drives}."
    with_prior, table = [each for each in found.figures if each.prior > 0.0], noise_section(found)
    low, value, high = (np.array([getattr(e, name) / e.prior for e in with_prior]) for name in ("low", "value", "high"))
    names = tuple(item.label for item, each in zip(table.items, found.figures, strict=False) if each in with_prior)
    curves = bars(["95 % interval"] * len(with_prior), {"95 % interval": BLUE}, low, high, names)
    curves.append(Curve("estimate", value, np.arange(1.0 * len(with_prior)), VERMILLION, "points", text=names))
    panel = row_panel("noise", "Noise relative to the prior", "noise / prior [-]", curves, names)
    figure = drawn("noise", panel.title, (replace(panel, log="x"),))
    return Page(f"Noise of an IMU: {found.spec.name}", (summary,), (table, figure))


def texts(result: Result[Tuned]) -> dict[str, str]:
    """Return the contents of ``imu.toml``: the IMU error specification with the estimated noise."""
    return {"imu.toml": to_toml(result.found.spec)}


def frame(result: Result[Tuned]) -> DataFrame:
    """Build a table of the noise parameters, one row each, with prior and 95 % interval."""
    rows = []
    for each in result.found.figures:
        factor = UNITS[each.unit][1] if each.unit else 1.0
        values = {name: getattr(each, name) / factor for name in ("prior", "value", "low", "high")}
        rows.append(of_table("tune.figure", each, **values))
    return rows_frame(rows)
