"""Fleet report on one page: drives with outliers first, failures, and the noise estimated in each vehicle."""

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

OUTLIER, FEWEST = 3.5, 8  # modified z-score of an outlier, and least number of drives
_LEAST = 0.1  # relative scatter of a fleet below which no drive is an outlier
_ORDER = ("failed", "bad", "attention", "unknown", "good")
# key, path in ``run.json``, unit of the table, label
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
_NONE_REJECTED = 0.01  # shares below this count as equal
_NOISE = (
    *("gyro_random_walk", "gyro_bias_instability", "accel_random_walk", "accel_bias_instability"),
    *("gps_horizontal", "gps_vertical", "gps_velocity"),
)


@dataclass(frozen=True, slots=True)
class Row:
    """Table row of one drive."""

    drive: Navigated
    light: str  # rating of its run, or ``failed``
    reason: str
    figures: Mapping[str, float] = field(default_factory=dict)  # SI, by key; unknown values are absent
    noise: tuple[Quantity, ...] = ()  # estimates with 95 % intervals
    score: float = 0.0  # largest modified z-score of its figures
    stands_out: str = ""  # figure of the largest score, beyond `OUTLIER`

    def quantities(self) -> tuple[Quantity, ...]:
        """Return the cells of the table."""
        reason = "; ".join(filter(None, (f"{self.stands_out} stands out" * bool(self.stands_out), self.reason)))
        names = {"drive": Name(self.drive.name), "vehicle": Name(self.drive.vehicle)}
        return (
            *of_table("fleet.drive", result=phrase(f"light.{self.light}"), **names),
            *(Quantity(key, self.figures.get(key), unit, meaning=label) for key, _, unit, label in _FIGURES),
            Quantity("outlier", self.score or None, meaning="z-score", digits=2, mark="!" * bool(self.stands_out)),
            Quantity("reason", reason, meaning="why"),
        )


def rows_of(drives: Sequence[Navigated]) -> list[Row]:
    """Build the rows of drives, failures and outliers first."""
    rows = [_row(each) for each in drives]
    scores: list[dict[str, float]] = [{} for _ in rows]
    for key in _COMPARED:
        known = {i: row.figures[key] for i, row in enumerate(rows) if key in row.figures}
        if key == "rejected":
            known = {i: max(share, _NONE_REJECTED) for i, share in known.items()}
        known = {i: value for i, value in known.items() if value > 0.0}
        for i, score in zip(known, modified_z(np.log(list(known.values()))), strict=True):
            scores[i][key] = float(score)
    found = [_scored(row, score) for row, score in zip(rows, scores, strict=True)]
    return sorted(found, key=lambda row: (_ORDER.index(row.light), not row.stands_out, -row.score, row.drive.name))


def modified_z(values: FloatArray) -> FloatArray:
    """Compute the distance of each value (n,) from the median in robust standard deviations; zero for few values.

    Iglewicz and Hoaglin, How to Detect and Handle Outliers, 1993: beyond 3.5 a value is an outlier.
    """
    if len(values) < FEWEST:
        return np.zeros(len(values))
    away = values - np.median(values)
    return np.asarray(away / max(float(np.median(np.abs(away))) / 0.6745, _LEAST))


def _row(drive: Navigated) -> Row:
    if drive.facts is None:
        return Row(drive, "failed", "" if drive.failed is None else drive.failed.reason)
    smoothed, filtered = (drive.facts.get(name) or {} for name in ("smoothed", "solution"))
    best = smoothed.get("accuracy") or drive.facts.get("accuracy")
    facts = {**drive.facts, "best": best, "last": smoothed or filtered}
    fixes = (facts.get("fixes") or {}).get("position") or {}
    if fixes.get("processed"):
        fixes["share_rejected"] = fixes["rejected"] / fixes["processed"]
    found = {key: _at(facts, path) for key, path, _, _ in _FIGURES}
    verdict = facts.get("verdict") or {}
    light, reason = verdict.get("light", "unknown"), verdict.get("reason", "")
    findings = map(Finding.from_dict, facts.get("findings", ()))
    first = next((each for each in findings if each.severity is Severity.WARNING), None)
    if light == "attention" and first is not None:
        reason += form("brackets").format(render(first).title)
    return Row(
        drive,
        light if drive.failed is None else "bad",
        ("" if light == "good" else reason) if drive.failed is None else drive.failed.reason,
        {key: float(value) for key, value in found.items() if isinstance(value, float | int)},
        tuple(_noise(facts.get("noise") or {})),
    )


def _at(facts: Any, path: Iterable[str]) -> Any:
    for key in path:
        facts = facts.get(key) if isinstance(facts, Mapping) else None
    return facts


def _noise(facts: Mapping[str, Any]) -> Iterable[Quantity]:
    """Yield noise parameters of a drive that have an interval."""
    for key, ends in facts.items():
        name = key.replace("_interval", "")
        found = quantity_of(name, facts.get(name))
        if name != key and found.key in _NOISE and min(ends) > 0.0:
            size = np.asarray(found.value) / facts[name]  # unit size in SI
            yield Quantity(found.key, found.value, found.unit, interval=(float(ends[0] * size), float(ends[1] * size)))


def _scored(row: Row, scores: Mapping[str, float]) -> Row:
    key = max(scores, key=lambda each: abs(scores[each]), default="")
    score = abs(scores.get(key, 0.0))
    label = next((label for name, _, _, label in _FIGURES if name == key and score > OUTLIER), "")
    return replace(row, score=score, stands_out=label)


def vehicle_noise(rows: Iterable[Row]) -> dict[str, list[Quantity]]:
    """Combine the noise estimates of each vehicle: log means over its drives, weighted by intervals.

    If drives differ more than their intervals imply, the interval of the mean is widened by that factor (Birge, The
    calculation of errors by the method of least squares, Physical Review 40, 1932).
    """
    found: dict[str, list[Quantity]] = {}
    for row in rows:
        if row.noise:
            found.setdefault(Name(row.drive.vehicle or row.drive.name), []).extend(row.noise)
    return {
        name: [_mean(own) for key in _NOISE if (own := [each for each in found[name] if each.key == key])]
        for name in sorted(found)
    }


def _mean(values: list[Quantity]) -> Quantity:
    """Compute the mean of one noise parameter over drives, with its interval."""
    size = np.log([np.asarray(each.value, dtype=np.float64) for each in values])
    sd = np.ptp(np.log([each.interval or (1.0, 1.0) for each in values]), axis=1) / (2.0 * 1.96)
    weight = 1.0 / np.maximum(sd, 1e-6) ** 2
    mean = float(weight @ size / weight.sum())
    birge = float(np.sqrt(weight @ (size - mean) ** 2 / max(len(values) - 1, 1)))
    half = 1.96 * max(birge, 1.0) / float(np.sqrt(weight.sum()))
    interval = (float(np.exp(mean - half)), float(np.exp(mean + half)))
    return Quantity(values[0].key, float(np.exp(mean)), values[0].unit, interval=interval)


def page(result: Result[tuple[Navigated, ...]]) -> Page:
    """Lay out a fleet."""
    rows = rows_of(result.found)
    total, kept = len(rows), sum(row.drive.kept for row in rows)
    count = {light: sum(row.light == light for row in rows) for light in _ORDER}
    out = max((row for row in rows if row.stands_out), key=lambda row: row.score, default=None)
    shown = form("list").join(phrase("terminal.line", name=phrase(f"light.{x}"), text=n) for x, n in count.items() if n)
    outcome = f"{shown}{form('stop')}" if out is None else f"{shown}; {out.drive.name} stands out most."
    wrong = count["failed"] + count["bad"]
    calm: Light = "unknown" if count["unknown"] else "good"
    light: Light = "bad" if wrong else "attention" if count["attention"] or out else calm
    reason = f"{wrong} of {total} drives failed or are not to be relied on" if wrong else f"none of {total} failed"
    if light == "attention":
        some = f"results of {count['attention']} of {total} drives need attention"
        reason = some if count["attention"] or out is None else f"{out.drive.name} stands out"
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
    """Remove empty columns from rows."""
    known = {each.key for row in rows for each in row if each.value not in (None, "")}
    return tuple(tuple(each for each in row if each.key in known) for row in rows)


def _panels(rows: Sequence[Row]) -> tuple[Panel, ...]:
    """Draw the NIS of every drive, in table order."""
    curves = []
    for label, colour in (("position", BLUE), ("velocity", GREEN)):
        key = f"nis_{label}"
        known = [(place, row.figures[key], row.drive.name) for place, row in enumerate(rows, 1) if key in row.figures]
        if known:
            x, y, names = zip(*known, strict=True)
            curves.append(Curve(label, np.array(x, float), np.array(y), colour, "crosses", text=names))
    title, axis = "Normalised innovations (NIS)", "place in the table"
    edges = np.array([0.5, len(rows) + 0.5])  # margin for the first and the last
    curves.append(Curve("", edges, np.ones(2), VERMILLION, "thin"))
    panel = Panel("fleet", title, "NIS per axis", axis, tuple(curves), log="y", levels=((1.0, "ideal"),), height=240)
    return (panel,) if curves[1:] else ()


def texts(result: Result[tuple[Navigated, ...]]) -> dict[str, str]:
    """Return the file text of the drives' table."""
    table, text = [_csv_row(row) for row in rows_of(result.found)], io.StringIO()
    writer = csv.DictWriter(text, list(dict.fromkeys(name for row in table for name in row)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return {"fleet.csv": text.getvalue()}


def frame(result: Result[tuple[Navigated, ...]]) -> DataFrame:
    """Build a table of the drives, failures and outliers first."""
    return rows_frame(map(Row.quantities, rows_of(result.found)))


def write_fleet(folder: Path, result: Result[tuple[Navigated, ...]]) -> None:
    """Write page, table and ``run.json`` of a fleet next to its drives; each file is complete or unchanged."""
    made = result.save(folder / ".summary", force=True)
    for name in FILES:  # the last file marks completeness
        (made / name).replace(folder / name)
    made.rmdir()


def _csv_row(row: Row) -> dict[str, Any]:
    known = (fact for each in row.quantities() + row.noise for fact in each.facts().items())
    facts = {name: value for name, value in known if "_interval" not in name}
    code = 0 if row.drive.failed is None else row.drive.failed.exit_code
    return {**facts, "result": row.light, "exit_code": code, "file": cell_text(row.drive.file)}
