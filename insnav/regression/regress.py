"""Accuracy of this version against the baseline, and the history (``history.jsonl``): one line per version."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from insnav.engine import Workers
from insnav.exceptions import InputError
from insnav.output.folder import write_text
from insnav.regression.baseline import BASELINE_FILE, Baseline, Origin, kept_text, origin, read_baseline, short
from insnav.regression.corpus import default_corpus, load_corpus
from insnav.regression.evaluate import BY_KEY, Accuracy, run_corpus
from insnav.regression.verdict import Comparison, Verdict, compare, interval
from insnav.result import Result

HISTORY_FILE = "history.jsonl"
_DIGITS = 4  # of stored figures

Value = tuple[float, float, float]  # typical value, and its 95 % interval


@dataclass(frozen=True, slots=True)
class Entry:
    """History entry of one version."""

    origin: Origin
    digests: dict[str, str]  # of every case and its files
    data: dict[str, dict[str, str]]  # for each recorded case the digests of its files
    # for each case its metrics: typical value and 95 % interval, NaN if unknown
    metrics: dict[str, dict[str, Value]]
    # for each case the metrics that changed relative to the baseline of that time
    verdicts: dict[str, dict[str, Verdict]]


def entry(result: Accuracy, comparison: Comparison | None, origin: Origin) -> Entry:
    """Summarise a run of the whole corpus."""
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
    """Read all versions, oldest first. Raises: InputError: a line is damaged."""
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
    """Add a version at the end, or replace the entry of the same version and commit."""
    mark = (new.origin.version, new.origin.commit)
    marks = [(each.origin.version, each.origin.commit) for each in history]
    if mark not in marks:
        return [*history, new]
    return [new if here == mark else each for here, each in zip(marks, history, strict=True)]


def write_history(path: Path, history: Sequence[Entry]) -> None:
    """Write all versions, one per line. Raises: OutputError: the file cannot be written."""
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
    metrics = {
        name: {key: _value(value) for key, value in metrics.items() if key in BY_KEY}
        for name, metrics in content["metrics"].items()
    }
    return Entry(Origin(**content["origin"]), content["digests"], content["data"], metrics, content["verdicts"])


def _value(numbers: list[float | None]) -> Value:
    middle, low, high = (np.nan if number is None else float(number) for number in numbers)
    return middle, low, high


@dataclass(frozen=True)
class Regression:
    """Accuracy of this version, and its changes since the baseline."""

    accuracy: Accuracy
    baseline: Baseline | None
    origin: Origin  # of this version
    history: tuple[Entry, ...] = ()  # oldest first; this version is the last unless partial

    @cached_property
    def comparison(self) -> Comparison | None:
        """Changes since the baseline, if any."""
        return None if self.baseline is None else compare(self.accuracy, self.baseline)


def regress(
    corpus: str | Path | None = None,
    data: str | Path | None = None,
    *,
    reports: str | Path | None = None,
    quick: bool = False,
    workers: Workers = "processes",
    stage: Callable[[str, float | None], None] = lambda name, fraction: None,
) -> Result[Regression]:
    """Navigate all drives of a corpus, and compare the accuracy with the baseline.

    Parameters
    ----------
    corpus : path, optional
        The drives, by default ``trajectories/corpus.toml`` of insnav.
    data : path, optional
        Folder of recorded drives, by default ``shared/data`` next to the project.
    reports : path, optional
        Folder of the baseline and the history, by default ``reports`` next to the folder of the corpus.
    quick : bool
        Run only some cases.
    workers, stage
        Where to compute; called with the name of each stage of the work and its completed fraction.

    Returns
    -------
    Result of Regression
        ``found.comparison.passed``: no figure of merit is worse than in the baseline.

    Raises
    ------
    ConfigError, InputError
        The corpus, the baseline or the history cannot be read.
    """
    file = default_corpus() if corpus is None else Path(corpus).resolve()
    drives, project = load_corpus(file), file.resolve().parent.parent
    recorded = project.parent / "shared" / "data" if data is None else Path(data)
    folder = project / "reports" if reports is None else Path(reports)
    baseline, history = read_baseline(folder / BASELINE_FILE), read_history(folder / HISTORY_FILE)
    stage("navigating", None)
    accuracy = run_corpus(
        drives, recorded, quick=quick, workers=workers, progress=lambda fraction: stage("navigating", fraction)
    )
    found = Regression(accuracy, baseline, origin(file.parent), tuple(history))
    if not quick:
        found = replace(found, history=tuple(with_entry(history, entry(accuracy, found.comparison, found.origin))))
    options = {"corpus": file, "data": recorded, "reports": folder, "quick": quick}
    return Result("regression", found, options=options)
