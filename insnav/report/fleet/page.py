"""Report of a fleet of drives on one page: table of the drives, failures, and noise estimates of each vehicle."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from insnav.findings import Finding, Severity
from insnav.fleet.batch import DRIVES, FILES, Navigated
from insnav.messages import form, phrase, render
from insnav.plain_text import Name, cell_text
from insnav.quantity import Quantity, quantity_of
from insnav.report.page import DataFrame, Light, Page, Section, Verdict, one_each, rows_frame
from insnav.report.panels import Curve, Panel
from insnav.report.style import BLUE, GREEN, VERMILLION
from insnav.report.tables import of_table
from insnav.result import Result
from insnav.types import FloatArray

OUTLIER, FEWEST = 3.5, 8  # modified z-score from which a drive is an outlier; smallest number of drives for scores
_LEAST = 0.1  # smallest relative scatter in z-scores, so that small differences in a uniform fleet are no outliers
_ORDER = ("failed", "bad", "attention", "unknown", "good")
# columns of the table: key, path in ``run.json``, unit in the table, label
_FIGURES = (
    ("duration", ("solution", "duration_s"), "s", ""),
    ("distance", ("solution", "distance_m"), "m", ""),
    ("horizontal_error", ("best", "all", "horizontal_m", "rms"), "m", "horizontal error RMS"),
    ("horizontal_sd", ("last", "horizontal_sd_m"), "m", "horizontal sd"),
    ("nis_position", ("fixes", "position", "nis_mean_per_axis"), "", "NIS position"),
    ("nis_velocity", ("fixes", "velocity", "nis_mean_per_axis"), "", "NIS velocity"),
    ("rejected", ("fixes", "position", "share_rejected"), "%", "fixes rejected"),
)
_COMPARED = ("horizontal_error", "horizontal_sd", "nis_position", "nis_velocity", "rejected")
_NONE_REJECTED = 0.01  # z-scores treat smaller shares of rejected fixes as this share
_NOISE = (
    *("gyro_random_walk", "gyro_bias_instability", "accel_random_walk", "accel_bias_instability"),
    *("gps_horizontal", "gps_vertical", "gps_velocity"),
)


@dataclass(frozen=True, slots=True)
class Row:
    """Table row of one drive."""

    drive: Navigated
    light: str  # traffic light of the run, or ``failed``
    reason: str  # reason for the traffic light
    figures: Mapping[str, float] = field(default_factory=dict)  # values in SI by key; unknown values are absent
    noise: tuple[Quantity, ...] = ()  # noise estimates with 95 % intervals
    score: float = 0.0  # largest modified z-score of the figures
    stands_out: str = ""  # label of the figure with this score, if it exceeds `OUTLIER`

    def quantities(self) -> tuple[Quantity, ...]:
        """Return the cells of the row, one per column of the table."""
        reason = "; ".join(filter(None, (f"{self.stands_out} stands out" * bool(self.stands_out), self.reason)))
        names = {"drive": Name(self.drive.name), "vehicle": Name(self.drive.vehicle)}
        return (
            *of_table("fleet.drive", result=phrase(f"light.{self.light}"), **names),
            *(Quantity(key, self.figures.get(key), unit, meaning=label) for key, _, unit, label in _FIGURES),
            Quantity("outlier", self.score or None, meaning="z-score", digits=2, mark="!" * bool(self.stands_out)),
            Quantity("reason", reason, meaning="why"),
        )


def rows_of(drives: Sequence[Navigated]) -> list[Row]:
    """Build the table rows of all drives, sorted by rating (failed first), then outliers first."""
    rows = [_row(each) for each in drives]
    scores: list[dict[str, float]] = [{} for _ in rows]
    for key in _COMPARED:
        values = {i: row.figures[key] for i, row in enumerate(rows) if key in row.figures}
        if key == "rejected":
            values = {i: max(share, _NONE_REJECTED) for i, share in values.items()}
        values = {i: value for i, value in values.items() if value > 0.0}
        for i, score in zip(values, modified_z(np.log(list(values.values()))), strict=True):
            scores[i][key] = float(score)
    scored = [_scored(row, score) for row, score in zip(rows, scores, strict=True)]
    return sorted(scored, key=lambda row: (_ORDER.index(row.light), not row.stands_out, -row.score, row.drive.name))


def modified_z(values: FloatArray) -> FloatArray:
    """Compute modified z-scores (n,): deviation from the median over robust sd; zero for fewer than `FEWEST` values.

    Iglewicz and Hoaglin, How to Detect and Handle Outliers, 1993: beyond 3.5 a value is an outlier.
    """
    if len(values) < FEWEST:
        return np.zeros(len(values))
    deviation = values - np.median(values)
    return np.asarray(deviation / max(float(np.median(np.abs(deviation))) / 0.6745, _LEAST))


def _row(drive: Navigated) -> Row:
    if drive.facts is None:
        return Row(drive, "failed", "" if drive.failed is None else drive.failed.reason)
    smoothed, filtered = (drive.facts.get(name) or {} for name in ("smoothed", "solution"))
    best = smoothed.get("accuracy") or drive.facts.get("accuracy")
    facts = {**drive.facts, "best": best, "last": smoothed or filtered}
    fixes = (facts.get("fixes") or {}).get("position") or {}
    if fixes.get("processed"):
        fixes["share_rejected"] = fixes["rejected"] / fixes["processed"]
    figures = {key: _at(facts, path) for key, path, _, _ in _FIGURES}
    verdict = facts.get("verdict") or {}
    light, reason = verdict.get("light", "unknown"), verdict.get("reason", "")
    findings = map(Finding.from_dict, facts.get("findings", ()))
    first_warning = next((each for each in findings if each.severity is Severity.WARNING), None)
    if light == "attention" and first_warning is not None:
        reason += form("brackets").format(render(first_warning).title)
    return Row(
        drive,
        light if drive.failed is None else "bad",
        ("" if light == "good" else reason) if drive.failed is None else drive.failed.reason,
        {key: float(value) for key, value in figures.items() if isinstance(value, float | int)},
        tuple(_noise(facts.get("noise") or {})),
    )


def _at(facts: Any, path: Iterable[str]) -> Any:
    for key in path:
        facts = facts.get(key) if isinstance(facts, Mapping) else None
    return facts


def _noise(facts: Mapping[str, Any]) -> Iterable[Quantity]:
    """Yield the noise parameters of a drive that have a 95 % interval."""
    for key, ends in facts.items():
        name = key.replace("_interval", "")
        noise = quantity_of(name, facts.get(name))
        if name != key and noise.key in _NOISE and min(ends) > 0.0:
            size = np.asarray(noise.value) / facts[name]  # the unit of ``run.json`` in SI
            yield Quantity(noise.key, noise.value, noise.unit, interval=(float(ends[0] * size), float(ends[1] * size)))


def _scored(row: Row, scores: Mapping[str, float]) -> Row:
    key = max(scores, key=lambda each: abs(scores[each]), default="")
    score = abs(scores.get(key, 0.0))
    label = next((label for name, _, _, label in _FIGURES if name == key and score > OUTLIER), "")
    return replace(row, score=score, stands_out=label)


def vehicle_noise(rows: Iterable[Row]) -> dict[str, list[Quantity]]:
    """Combine the noise estimates of each vehicle: mean of the logarithms over its drives, weighted by intervals.

    If drives differ more than their intervals imply, the interval of the mean is widened by that factor (Birge, The
    calculation of errors by the method of least squares, Physical Review 40, 1932).
    """
    estimates: dict[str, list[Quantity]] = {}
    for row in rows:
        if row.noise:
            estimates.setdefault(Name(row.drive.vehicle or row.drive.name), []).extend(row.noise)
    return {
        name: [_mean(values) for key in _NOISE if (values := [each for each in estimates[name] if each.key == key])]
        for name in sorted(estimates)
    }


def _mean(values: list[Quantity]) -> Quantity:
    """Compute the weighted mean of one noise parameter over drives, with its 95 % interval."""
    size = np.log([np.asarray(each.value, dtype=np.float64) for each in values])
    sd = np.ptp(np.log([each.interval or (1.0, 1.0) for each in values]), axis=1) / (2.0 * 1.96)
    # means and standard deviations are of logarithms; an interval of 95 % is 2 times 1.96 sd wide
    weight = 1.0 / np.maximum(sd, 1e-6) ** 2
    mean = float(weight @ size / weight.sum())
    birge = float(np.sqrt(weight @ (size - mean) ** 2 / max(len(values) - 1, 1)))
    half = 1.96 * max(birge, 1.0) / float(np.sqrt(weight.sum()))
    interval = (float(np.exp(mean - half)), float(np.exp(mean + half)))
    return Quantity(values[0].key, float(np.exp(mean)), values[0].unit, interval=interval)


def page(result: Result[tuple[Navigated, ...]]) -> Page:
    """Lay out a fleet: table of drives, failures, and noise of each vehicle."""
    rows = rows_of(result.found)
    total, kept = len(rows), sum(row.drive.kept for row in rows)
    count = {light: sum(row.light == light for row in rows) for light in _ORDER}
    outlier = max((row for row in rows if row.stands_out), key=lambda row: row.score, default=None)
    shown = form("list").join(phrase("terminal.line", name=phrase(f"light.{x}"), text=n) for x, n in count.items() if n)
    outcome = f"{shown}{form('stop')}" if outlier is None else f"{shown}; {outlier.drive.name} stands out most."
    wrong = count["failed"] + count["bad"]
    calm: Light = "unknown" if count["unknown"] else "good"
    light: Light = "bad" if wrong else "attention" if count["attention"] or outlier else calm
    reason = f"{wrong} of {total} drives failed or are not to be relied on" if wrong else f"none of {total} failed"
    if light == "attention":
        text = f"results of {count['attention']} of {total} drives need attention"
        reason = text if count["attention"] or outlier is None else f"{outlier.drive.name} stands out"
    failed = [(row.drive.name, row.drive.failed) for row in rows if row.drive.failed is not None]
    failures = tuple(of_table("fleet.failure", each, drive=Name(name)) for name, each in failed)
    note = (
        f"outliers first; z-score: largest of error, sd, NIS and rejected fixes, against the fleet; ! beyond {OUTLIER}"
    )
    note *= any(row.score for row in rows)
    noise = "with 95 % interval; drives of unnamed vehicles are separate; values of GPS are factors of the stated sd"
    cells = tuple(map(Row.quantities, rows))
    return Page(
        f"Fleet of {total} drives",
        (f"Each drive has its run folder in {DRIVES}/; {kept} of {total} were finished already.",),
        (
            Section("drives", rows=cells, show="json"),
            Section("", "Drives", rows=nonempty_columns(cells), panels=_panels(rows), note=note),
            Section("failures", "Drives that failed", rows=failures, show="page"),
            one_each("vehicles", "Noise found in each vehicle", vehicle_noise(rows), "vehicle", noise),
        ),
        findings=result.findings,
        verdict=Verdict(light, reason, outcome),
        merits=(
            Quantity("drives", total),
            *(Quantity(name, n, meaning=phrase(f"light.{name}")) for name, n in count.items() if n),
        ),
        names=frozenset(name for row in rows for name in (row.drive.name, row.drive.vehicle)),
    )


def nonempty_columns(rows: Sequence[Sequence[Quantity]]) -> tuple[tuple[Quantity, ...], ...]:
    """Remove the columns that are empty in all rows."""
    nonempty = {each.key for row in rows for each in row if each.value not in (None, "")}
    return tuple(tuple(each for each in row if each.key in nonempty) for row in rows)


def _panels(rows: Sequence[Row]) -> tuple[Panel, ...]:
    """Draw the mean NIS of every drive, in the order of the table."""
    curves = []
    for label, colour in (("position", BLUE), ("velocity", GREEN)):
        key = f"nis_{label}"
        points = [(place, row.figures[key], row.drive.name) for place, row in enumerate(rows, 1) if key in row.figures]
        if points:
            x, y, names = zip(*points, strict=True)
            curves.append(Curve(label, np.array(x, float), np.array(y), colour, "crosses", text=names))
    title, axis = "Normalised innovations (NIS)", "place in the table"
    edges = np.array([0.5, len(rows) + 0.5])  # half a place of margin on either side of the drives
    curves.append(Curve("", edges, np.ones(2), VERMILLION, "thin"))
    panel = Panel("fleet", title, "NIS per axis", axis, tuple(curves), log="y", levels=((1.0, "ideal"),), height=240)
    return (panel,) if curves[1:] else ()


def texts(result: Result[tuple[Navigated, ...]]) -> dict[str, str]:
    """Return the contents of ``fleet.csv``, the table of the drives."""
    table, text = [_csv_row(row) for row in rows_of(result.found)], io.StringIO()
    writer = csv.DictWriter(text, list(dict.fromkeys(name for row in table for name in row)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return {"fleet.csv": text.getvalue()}


def frame(result: Result[tuple[Navigated, ...]]) -> DataFrame:
    """Build a table of the drives, in the order of `rows_of`."""
    return rows_frame(map(Row.quantities, rows_of(result.found)))


def write_fleet(folder: Path, result: Result[tuple[Navigated, ...]]) -> None:
    """Write page, table and ``run.json`` of a fleet next to its drives; each file is complete or unchanged."""
    summary = result.save(folder / ".summary", force=True)
    for name in FILES:  # the last of these files marks a complete fleet folder
        (summary / name).replace(folder / name)
    summary.rmdir()


def _csv_row(row: Row) -> dict[str, Any]:
    cells = (fact for each in row.quantities() + row.noise for fact in each.facts().items())
    facts = {name: value for name, value in cells if "_interval" not in name}
    code = 0 if row.drive.failed is None else row.drive.failed.exit_code
    return {**facts, "result": row.light, "exit_code": code, "file": cell_text(row.drive.file)}
