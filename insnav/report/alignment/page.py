"""Report of an alignment without navigation: coarse and fine attitude, and latitude."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from insnav.alignment.static import CONTRADICTED
from insnav.earth import OMEGA_EARTH
from insnav.filter.fine_alignment import FineAlignment
from insnav.findings import Code, Finding
from insnav.imu.specification import gyro_bias_sd
from insnav.messages import render
from insnav.quantity import Quantity
from insnav.report.page import DataFrame, Light, Page, Section, by_warnings, drawn, only_json, rows_frame
from insnav.report.panels import Curve, row_panel
from insnav.report.run.quantities import alignment_items
from insnav.report.style import BLUE, number
from insnav.report.terminal import entry
from insnav.result import Result
from insnav.types import Alignment
from insnav.units import DEG

_USEFUL = 10.0 * DEG  # a latitude computed from the sensors is shown only if its sd is smaller [rad]


def page(result: Result[FineAlignment]) -> Page:
    """Lay out an alignment: attitude and its sd after each step, and latitude."""
    alignment = result.found
    latitude_sd = None
    if result.imu_model is not None:
        # sd of the latitude from the sensors [rad]: gyro bias over Earth rate, at most a right angle
        latitude_sd = min(float(np.max(gyro_bias_sd(result.imu_model[0].gyro))) / OMEGA_EARTH, 0.5 * np.pi)
    steps, warnings = _steps(alignment), tuple(_warnings(alignment, latitude_sd))
    known = np.isfinite((alignment.fine or alignment.coarse).sd[2])
    light: tuple[Light, str] = ("good", "the heading is known") if known else ("attention", "the heading is not known")
    names = [f"{name} {axis}" for name in steps for axis in ("tilt north", "tilt east", "heading")]
    sizes = np.concatenate([each.sd for each in steps.values()]) / DEG
    points = Curve("sd", sizes, np.arange(1.0 * len(names)), BLUE, "points", text=tuple(names))
    panel = replace(row_panel("attitude", "Standard deviations of the attitude", "sd [deg]", [points], names), log="x")
    tables = [Section(k, f"{k.capitalize()} alignment", alignment_items(e), show="page") for k, e in steps.items()]
    latitude = (
        Quantity("latitude_given", alignment.latitude, "deg", decimals=4),
        Quantity("latitude_from_sensors", alignment.sensor_latitude, "deg", sd=latitude_sd),
    )
    return Page(
        "Alignment",
        _summary(alignment, latitude_sd),
        (
            *tables,
            *(() if alignment.fine else (only_json("", Quantity("fine", None)),)),
            Section("", "Latitude", latitude, show="page"),
            drawn("attitude", panel.title, (panel,)),
        ),
        warnings,
        verdict=by_warnings(_sentence(alignment.fine or alignment.coarse), warnings, light),
    )


def _steps(found: FineAlignment) -> dict[str, Alignment]:
    """Return the coarse alignment, and the fine alignment if there is one, by name."""
    return {"coarse": found.coarse} | ({"fine": found.fine} if found.fine else {})


def _sentence(found: Alignment) -> str:
    """Write roll, pitch and heading in one sentence."""
    (roll, pitch, heading), sd = found.rph / DEG, found.sd[2] / DEG
    heading_text = f"heading {heading % 360.0:.2f} ± {number(sd, 2)} deg" if np.isfinite(sd) else "no heading"
    return f"Roll {roll:.3f} deg, pitch {pitch:.3f} deg, {heading_text}."


def _warnings(found: FineAlignment, sd: float | None) -> Iterator[Finding]:
    """Yield a warning if sensors and given latitude contradict each other. `sd`: sd of the sensors' latitude [rad]."""
    difference = abs(found.sensor_latitude - found.latitude)
    if sd is not None and difference >= CONTRADICTED * sd:
        limit = CONTRADICTED * sd
        yield Finding.of(Code.ALIGN_LATITUDE, off_rad=difference, limit_rad=limit, latitude_rad=found.latitude)


def _summary(found: FineAlignment, sd: float | None) -> tuple[str, ...]:
    """Write lines with stationary interval, attitude of each alignment, and latitude. `sd`: as in `_warnings`."""
    lines = []
    if found.coarse.static is not None:
        start, end = (round(time, 1) + 0.0 for time in found.coarse.static)
        lines.append(entry("static", f"{start:.1f} to {end:.1f} s, {end - start:.1f} s long"))
    for name, each in _steps(found).items():
        roll, pitch = (number(float(angle) / DEG, 4) for angle in each.rph[:2])
        tilt = number(float(max(each.sd[:2])) / DEG, 2)
        lines.append(entry(name, f"roll {roll}, pitch {pitch}, each ± {tilt} deg  ({_named(each.level_method)})"))
        lines.append(entry("", f"heading {_heading(each)}"))
    text = "not observable: the gyro bias hides the Earth's rotation"
    if sd is not None and sd < _USEFUL:
        text = f"{found.sensor_latitude / DEG:.4f} ± {number(sd / DEG, 2)} deg from the sensors alone"
    return (*lines, entry("latitude", f"{found.latitude / DEG:.4f} deg given, {text}"))


def _heading(found: Alignment) -> str:
    if not np.isfinite(found.sd[2]):
        return "not found: the gyros do not show the Earth's rotation well enough; give --heading, or a better --imu"
    heading, sd = number(float(found.rph[2]) / DEG % 360.0, 5), number(float(found.sd[2]) / DEG, 2)
    return f"{heading} ± {sd} deg  ({_named(found.heading_method)})"


def _named(method: str) -> str:
    """Return the name of an alignment method in words, from its code."""
    return render(Finding.of(Code(method))).title


def frame(result: Result[FineAlignment]) -> DataFrame:
    """Build a table with the attitude of each alignment step; columns: ``step``, ``time_s``, ``roll_deg``, …."""
    return rows_frame((Quantity("step", name), *alignment_items(each)) for name, each in _steps(result.found).items())
