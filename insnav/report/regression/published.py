"""``published.md``: published GNSS outage figures, the same tests simulated, and the field factor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from insnav.regression.provenance import Origin
from insnav.regression.published.replicas import Compared, FieldFactor
from insnav.report.html import filled
from insnav.report.numbers import number

FILE = "published.md"


def write_published(folder: Path, compared: Sequence[Compared], field: FieldFactor, now: Origin) -> Path:
    """Write the table into a folder."""
    missing = sorted({f"{each.case.imu}: {', '.join(each.missing)}" for each in compared if each.missing})
    places = sorted({f"{each.case.source.split(',')[0]}: {each.case.where}" for each in compared})
    lists = {"compared": compared, "missing": missing, "places": places}
    path = folder / FILE
    folder.mkdir(parents=True, exist_ok=True)
    text = filled("published.md.j2", field=field, now=now, number=number, **lists)
    path.write_text(text, encoding="utf-8", newline="\n")
    return path
