"""The history (``history.jsonl``): the accuracy of every version, one line each."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from insnav.exceptions import InputError
from insnav.output.folder import write_text
from insnav.regression.accuracy_metrics import BY_KEY, METRICS
from insnav.regression.baseline import kept_text, short
from insnav.regression.paired_tests import interval
from insnav.regression.provenance import Origin
from insnav.regression.run_corpus import Accuracy
from insnav.regression.verdict import Comparison, Verdict

HISTORY_FILE = "history.jsonl"
_DIGITS = 4  # of the figures kept

Value = tuple[float, float, float]  # typical, and its 95 % interval


@dataclass(frozen=True, slots=True)
class Entry:
    """One version."""

    origin: Origin
    digests: dict[str, str]  # of every case and the files behind it
    data: dict[str, dict[str, str]]  # for each recorded case the digests of its files
    # for each case its metrics: typical value and 95 % interval, NaN where not known
    metrics: dict[str, dict[str, Value]]
    # for each case the metrics that were better or worse than in the baseline of that time
    verdicts: dict[str, dict[str, Verdict]]


def entry(result: Accuracy, comparison: Comparison | None, origin: Origin) -> Entry:
    """Sum up a run of the whole corpus."""
    metrics = {
        name: {key: interval(value, BY_KEY[key], pieces=case.pieces) for key, value in case.measured.values.items()}
        for name, case in result.cases.items()
        if case.measured.values
    }
    verdicts: dict[str, dict[str, Verdict]] = {}
    for change in () if comparison is None else comparison.changes:
        if change.verdict != "same":
            verdicts.setdefault(change.case, {})[change.metric.key] = change.verdict
    digests = {name: case.digest for name, case in result.cases.items()}
    data = {name: case.files for name, case in result.cases.items() if case.files}
    return Entry(origin, digests, data, metrics, verdicts)


def read_history(path: Path) -> list[Entry]:
    """Read all versions, oldest first.

    Raises: InputError: a line is damaged.
    """
    found = []
    for row, line in enumerate((kept_text("regress.unreadable_history", path) or "").splitlines(), start=1):
        if not line.strip():
            continue
        try:
            found.append(_entry(json.loads(line)))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(
                "regress.damaged_history", where=f"{path}:{row}", kind=type(error).__name__, reason=str(error)
            ) from None
    return found


def with_entry(history: Sequence[Entry], new: Entry) -> list[Entry]:
    """Add a version at the end, or in the place of the same version and commit."""
    mark = (new.origin.version, new.origin.commit)
    marks = [(each.origin.version, each.origin.commit) for each in history]
    if mark not in marks:
        return [*history, new]
    return [new if here == mark else each for here, each in zip(marks, history, strict=True)]


def write_history(path: Path, history: Sequence[Entry]) -> None:
    """Write all versions, one a line.

    Raises: OutputError: it cannot be written.
    """
    lines = []
    for each in history:
        content = asdict(each)
        content["metrics"] = {
            name: {key: short(np.array(value), _DIGITS) for key, value in metrics.items()}
            for name, metrics in each.metrics.items()
        }
        lines.append(json.dumps(content, ensure_ascii=False, separators=(",", ":")))
    write_text(path, "\n".join(lines) + "\n")


def _entry(content: dict[str, Any]) -> Entry:
    known = {metric.key for metric in METRICS}
    metrics = {
        name: {key: _value(value) for key, value in metrics.items() if key in known}
        for name, metrics in content["metrics"].items()
    }
    return Entry(Origin(**content["origin"]), content["digests"], content["data"], metrics, content["verdicts"])


def _value(numbers: list[float | None]) -> Value:
    middle, low, high = (np.nan if number is None else float(number) for number in numbers)
    return middle, low, high
