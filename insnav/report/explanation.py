"""Table of the explanation of a record: faults considered, their gain, and their effect."""

from __future__ import annotations

import numpy as np

from insnav.explain.explanation import Explanation, Tried
from insnav.messages import phrase
from insnav.quantity import Quantity
from insnav.report.page import Section

MOST = 8  # rows


def explanation_section(found: Explanation) -> Section:
    """Build the table, best first; folded if no fault was accepted."""
    items = (
        Quantity("considered", len(found.tried), meaning="faults considered"),
        Quantity("passes", found.passes, meaning="passes over the linear record"),
        Quantity("runs", found.runs, meaning="runs of the filter"),
    )
    rows = tuple(_row(row) for row in found.tried[:MOST])
    table = Section("rows", "Considered faults", rows=rows, note=phrase("explanation.note"), show="page")
    folded = not any(row.accepted for row in found.tried)
    return Section("explanation", "Explanation", items, parts=(table,), show="page", folded=folded)


def explanation_line(found: Explanation) -> str:
    """Summarise the explanation in one line."""
    values = {"count": len(found.tried), "accepted": sum(row.accepted for row in found.tried), "passes": found.passes}
    return phrase("explanation.some" if values["accepted"] else "explanation.none", **values)


def _row(row: Tried) -> tuple[Quantity, ...]:
    return (
        Quantity("fault", phrase(f"fault.{row.name}")),
        Quantity("begin", row.begin, "s", decimals=1),
        Quantity("end", row.end if np.isfinite(row.end) else None, "s", decimals=1),
        Quantity("gain", row.gain),
        Quantity("prior", row.prior, meaning="prior cost"),
        Quantity("accepted", row.accepted),
        Quantity("size", row.size, row.unit),
        Quantity("changed", _changed(row)),
    )


def _changed(row: Tried) -> tuple[str, ...]:
    """Describe the effect of a fault."""
    fixes = {"left_out": row.left_out, "moved": row.moved}
    words = tuple(phrase(f"explanation.{how}", count=count) for how, count in fixes.items() if count)
    how = row.name if row.name in ("rough", "delay") else "corrected"
    return words if words or not row.accepted else (phrase(f"explanation.{how}"),)
