"""Report that compares several runs with one reference: a table row per solution."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.earth import ned_offset
from insnav.errors.evaluated_run import overconfident
from insnav.errors.metrics import Compared, Comparison, accuracy, nees
from insnav.findings import Finding
from insnav.output.data_files import write_table
from insnav.output.folder import RunFolder
from insnav.output.solution_tables import TableFormat
from insnav.plain_text import Name
from insnav.quantity import Quantity
from insnav.report import page as room
from insnav.report.page import DataFrame, Light, Page, Section, Verdict, by_warnings, drawn, rows_frame
from insnav.report.panels import LEAST_ERROR, Clock, Curve, Kind, Panel, Shade, Track, broken_at_gaps
from insnav.report.style import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION, number
from insnav.result import Result
from insnav.sample_statistics import rms
from insnav.strapdown import nearest_rows
from insnav.types import FloatArray
from insnav.units import UNITS

_MERITS = 6  # largest number of solutions among the figures of merit
_INSIDE = 0.95  # share of the errors inside 3 sd that confirms the stated sd
# table columns: key, heading, unit; then quantity and statistic in the result of `insnav.errors.metrics.accuracy`
_COLUMNS = (
    ("north", "N", "m", "north_m", "rms"),
    ("east", "E", "m", "east_m", "rms"),
    ("down", "D", "m", "down_m", "rms"),
    ("horizontal", "2D", "m", "horizontal_m", "rms"),
    ("horizontal_p95", "95 %", "m", "horizontal_m", "p95"),
    ("horizontal_max", "max", "m", "horizontal_m", "max"),
    ("velocity_horizontal", "v", "m/s", "velocity_horizontal_m_s", "rms"),
    ("roll", "roll", "deg", "roll_deg", "rms"),
    ("pitch", "pitch", "deg", "pitch_deg", "rms"),
    ("heading", "head", "deg", "heading_deg", "rms"),
)
_NOTE = "in 3 sd: share of position errors inside three stated standard deviations"
_COLOURS = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY)


def page(result: Result[Comparison]) -> Page:
    """Lay out a comparison of runs: a table of their errors, tracks, and error panels."""
    found, findings = result.found, (*_warnings(result.found), *result.findings)
    drawings = (drawn(each.key, each.title, (each,), each.note) for each in comparison_panels(found))
    runs = {each.run for each in found.compared}
    count, rows = len(found.compared[0].errors.time), tuple(map(_row, found.compared))
    return Page(
        f"{len(runs)} run{'s' * (len(runs) > 1)} against {result.inputs['reference'].path}",
        (f"{count} epochs of the reference that every run covers are compared.",),
        (Section("runs", "Accuracy, RMS", rows=rows, note=_NOTE), room.beside(*drawings)),
        findings,
        verdict=_verdict(found, findings),
        merits=tuple(
            Quantity(f"rms_{rank}", rms(errors.horizontal), "m", meaning=f"{name}, horizontal RMS")
            for rank, (name, errors) in enumerate(list(found.named().items())[:_MERITS], start=1)
        ),
        names=frozenset(runs),
    )


def _warnings(found: Comparison) -> tuple[Finding, ...]:
    """Return warnings if the errors exceed the stated sd, for the last solution of each run, as in its own report."""
    last = {each.run: named for each, named in zip(found.compared, found.named().items(), strict=True)}
    return tuple(each for name, errors in last.values() for each in overconfident(name, errors))


def _verdict(found: Comparison, findings: Sequence[Finding]) -> Verdict:
    """Rate a comparison: the solution with the smallest horizontal error, and whether its stated sd holds."""
    sizes = {name: rms(errors.horizontal) for name, errors in found.named().items()}
    best, *others = sorted(sizes, key=lambda name: sizes[name] if np.isfinite(sizes[name]) else np.inf)
    text = f"{best} has the smallest horizontal error, {number(sizes[best])} m RMS"
    if others:
        text += f"; {', '.join(f'{name} {number(sizes[name])}' for name in others[: _MERITS - 1])} m"
    consistency = nees(found.named()[best])
    position = None if consistency is None else consistency["position"]
    if position is None:
        return Verdict("unknown", f"{best} states no sd", f"{text}.")
    share = float(position["inside_3_sd"])
    light: Light = "good" if share >= _INSIDE else "attention"
    holds = "holds" if light == "good" else "is too small"
    reason = f"{100.0 * share:.0f} % of the errors of {best} inside 3 sd: its stated sd {holds}"
    return by_warnings(f"{text}.", findings, (light, reason))


def write_files(result: Result[Comparison], folder: RunFolder, table_format: TableFormat) -> None:
    """Write a table of the horizontal errors of every solution over time."""
    errors = result.found.named()
    time = next(iter(errors.values())).time
    columns: dict[str, FloatArray] = {f"{name} [m]": np.round(each.horizontal, 4) for name, each in errors.items()}
    write_table(folder.path("horizontal_errors.csv"), {"time_s": time, **columns})


def frame(result: Result[Comparison]) -> DataFrame:
    """Build a table of accuracy with a row per solution: ``run``, ``solution``, and errors by name with unit."""
    return rows_frame(_row(each) for each in result.found.compared)


def _row(of: Compared) -> tuple[Quantity, ...]:
    """Build the table row of a solution: its errors, and the share of position errors inside 3 sd."""
    errors, consistency = accuracy(of.errors) or {}, nees(of.errors)
    position = None if consistency is None else consistency["position"]
    row = [Quantity("run", Name(of.run)), Quantity("solution", of.solution)]
    for key, heading, unit, quantity, statistic in _COLUMNS:
        if errors.get(quantity) is not None:
            row.append(Quantity(key, errors[quantity][statistic] * UNITS[unit][1], unit, meaning=heading))
    inside = None if position is None else position["inside_3_sd"]
    return (*row, Quantity("inside_3_sd", inside, "%", meaning="in 3 sd"))


def comparison_panels(found: Comparison) -> tuple[Track, Panel, Panel]:
    """Draw the tracks, and horizontal errors over time and their distribution; smoothed solutions are dashed."""
    time = found.compared[0].errors.time
    clock, lla = Clock.of(time), found.reference.lla[nearest_rows(found.reference.time, time)]
    position = ned_offset(lla, lla[0])
    tracks, shades = [], []
    runs = list(dict.fromkeys(each.run for each in found.compared))
    over_time, shares = [], []
    for (name, errors), each in zip(found.named().items(), found.compared, strict=True):
        colour = _COLOURS[runs.index(each.run) % len(_COLOURS)]
        kind: Kind = "dashed" if each.solution == "smoothed" else "line"
        over_time.append(Curve(name, *broken_at_gaps(clock(errors.time), errors.horizontal), colour, kind))
        share = np.linspace(1.0, 100.0, 500)
        errors_at = np.maximum(np.nanpercentile(errors.horizontal, share), LEAST_ERROR)
        shares.append(Curve(name, errors_at, share, colour, kind))
        north, east, _ = (position + errors.position).T
        tracks.append(Curve(name, east, north, colour, kind))
        shades.append(Shade(f"error of {name} [m]", errors.horizontal))
    x, dashed, points = clock.label, "dashed: smoothed", (position[:, 1], position[:, 0], clock(time), tuple(shades))
    title, across, note = "Distribution of the horizontal error", "horizontal error [m]", "further left is better"
    return (
        Track("track", "Tracks", *points, "time", note="points: the reference", behind=tuple(tracks)),
        Panel("horizontal_error", "Horizontal error", "error [m]", x, tuple(over_time), "time", dashed, height=260),
        Panel("error_distribution", title, "epochs below [%]", across, tuple(shares), "share", note, "x", (0.0, 101.0)),
    )
