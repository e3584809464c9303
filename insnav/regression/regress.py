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
_DIGITS = 4  # significant digits of stored figures

Value = tuple[float, float, float]  # typical value, lower and upper end of its 95 % interval


@dataclass(frozen=True, slots=True)
class Entry:
    """History entry of one version."""

    origin: Origin
    digests: dict[str, str]  # digest of each case with its files
    data: dict[str, dict[str, str]]  # for each recorded case, the digest of each file
    metrics: dict[str, dict[str, Value]]  # for each case, its metrics; NaN if unknown
    verdicts: dict[str, dict[str, Verdict]]  # for each case, metrics that changed against the baseline of that time


def entry(result: Accuracy, comparison: Comparison | None, origin: Origin) -> Entry:
    """Summarise a run of the whole corpus as a history entry."""
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
    """Read the entries of all versions, oldest first. Raises: InputError: a line is damaged."""
    entries = []
    for row, line in enumerate((kept_text("regress.unreadable_history", path) or "").splitlines(), start=1):
        if not line.strip():
            continue
        try:
            entries.append(_entry(json.loads(line)))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(
                "regress.damaged_history", where=f"{path}:{row}", kind=type(error).__name__, reason=str(error)
            ) from None
    return entries


def with_entry(history: Sequence[Entry], new: Entry) -> list[Entry]:
    """Append the entry of a version, or replace the entry with the same version and commit."""
    current = (new.origin.version, new.origin.commit)
    keys = [(item.origin.version, item.origin.commit) for item in history]
    if current not in keys:
        return [*history, new]
    return [new if stored == current else item for stored, item in zip(keys, history, strict=True)]


def write_history(path: Path, history: Sequence[Entry]) -> None:
    """Write the entries of all versions, one per line. Raises: OutputError: the file cannot be written."""
    lines = []
    for item in history:
        content = asdict(item)
        content["metrics"] = {
            name: {key: short(np.array(value), _DIGITS) for key, value in metrics.items()}
            for name, metrics in item.metrics.items()
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
    origin: Origin  # version, commit, time and computer of this run
    history: tuple[Entry, ...] = ()  # oldest first; contains this version unless the run was quick

    @cached_property
    def comparison(self) -> Comparison | None:
        """Comparison with the baseline; None without a baseline."""
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
        Run only the cases and seeds of a quick evaluation.
    workers, stage
        Processes that compute; function called with the name of each stage of the work and its completed fraction.

    Returns
    -------
    Result of Regression
        ``found.comparison.passed``: no drive fails, and no figure of merit is worse beyond its limit.

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
    result = Regression(accuracy, baseline, origin(file.parent), tuple(history))
    if not quick:
        result = replace(result, history=tuple(with_entry(history, entry(accuracy, result.comparison, result.origin))))
    options = {"corpus": file, "data": recorded, "reports": folder, "quick": quick}
    return Result("regression", result, options=options)
