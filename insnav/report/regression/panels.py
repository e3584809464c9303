"""Matrices and panels of a regression run: accuracy over versions, error growth, predicted against actual error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.special import stdtrit

from insnav.messages import form, phrase, translated
from insnav.regression.baseline import Baseline
from insnav.regression.evaluate import FAILS_FROM, GROWTH, METRICS, Accuracy, CaseResult, Metric
from insnav.regression.regress import Entry
from insnav.regression.verdict import Change, Comparison, detectable
from insnav.report.page import Cell, Matrix, Table
from insnav.report.panels import Curve, Panel
from insnav.report.run.panels import GROUPS
from insnav.report.style import AXIS_COLOURS, BLACK, BLUE, GREEN, GREY, SKY, VERMILLION, number
from insnav.types import BoolArray, FloatArray

COLUMNS = 4  # number of panels side by side
_TICKS = 5  # largest number of version labels below a panel
_VERSIONS, _DRIVES = 8, 40  # largest numbers of versions and of drives in the details of a matrix cell
_STEPS = (0.05, 0.2)  # relative changes from which the colour of a cell becomes stronger [-]
TONES = (
    ("better3", "better by 20 %"),
    ("better2", "5 %"),
    ("better1", "1 %"),
    ("same", "no change that counts"),
    ("worse1", "worse by 1 %"),
    ("worse2", "5 %"),
    ("worse3", "20 % and more"),
    ("fails", "fails"),
    ("unclear", f"too few drives to detect a change of {100 * FAILS_FROM:g} %"),
)


def change_head(change: Change, size: str = "") -> str:
    """Write case, metric, old and new value of one change, and its size."""
    text = f"{number(change.old)} -> {number(change.new)} {change.metric.unit}".rstrip()
    text = phrase("terminal.line", name=translated(change.metric.label), text=text)
    return phrase("terminal.line", name=change.case, text=text) + (form("brackets").format(size) if size else "")


def figures_tested(comparison: Comparison) -> int:
    """Count the statistical tests of a comparison: one per figure, except for computing times."""
    return sum(change.metric.kind != "cpu" for change in comparison.changes)


def is_unclear(change: Change, tests: int) -> bool:
    """Return whether a change may be undetected: none is significant, and only changes above `FAILS_FROM` would be."""
    if change.verdict != "same" or change.metric.kind == "cpu":
        return False
    return detectable(change.shift, tests) > FAILS_FROM


def unclear_changes(comparison: Comparison) -> int:
    """Count the figures with a possibly undetected change; see `is_unclear`."""
    return sum(is_unclear(change, figures_tested(comparison)) for change in comparison.changes)


def change_matrix(result: Accuracy, comparison: Comparison, baseline: Baseline, history: Sequence[Entry]) -> Matrix:
    """Build a matrix of changes since the baseline, a row per case, a column per figure; details on history, drives."""
    tests, changes = figures_tested(comparison), {(each.case, each.metric.key): each for each in comparison.changes}
    metrics = [metric for metric in METRICS if any(key == metric.key for _, key in changes)]
    names = [name for name in result.cases if any(case == name for case, _ in changes)]

    def cell(row: int, column: int) -> Cell | None:
        change = changes.get((names[row], metrics[column].key))
        behind = () if change is None else _behind(change, result, baseline, history)
        return None if change is None else _cell(change, tests, f"cell-{row}-{column}", behind)

    rows = [(name, tuple(cell(row, column) for column in range(len(metrics)))) for row, name in enumerate(names)]
    return Matrix(tuple(metric.label for metric in metrics), tuple(rows), TONES)


def _cell(change: Change, tests: int, key: str, behind: tuple[Table, ...]) -> Cell:
    size = change.shift.change
    text = "·" if abs(size) < 0.005 else f"{100.0 * size:+.0f}"
    size_text = ""
    if change.metric.kind != "cpu":
        least = detectable(change.shift, tests)
        words = f"from {100.0 * least:.2g} % on a change is found" if np.isfinite(least) else "too few drives to test"
        size_text = f"{100.0 * size:+.1f} %, p {change.adjusted:.1g}{form('parts')}{translated(words)}"
    return Cell(text, _tone(change, tests), change_head(change, size_text), key, behind)


def _tone(change: Change, tests: int) -> str:
    if change.fails:
        return "fails"
    if change.verdict == "same":
        return "unclear" if is_unclear(change, tests) else "same"
    ratio = abs(np.log1p(change.shift.change))
    return f"{change.verdict}{1 + sum(ratio >= np.log1p(step) for step in _STEPS)}"


def _behind(change: Change, result: Accuracy, baseline: Baseline, history: Sequence[Entry]) -> tuple[Table, ...]:
    """Build the details of a matrix cell: the figure over the versions, and of every drive in baseline and now."""
    name, metric = change.case, change.metric
    rows = []
    for each in list(history)[-_VERSIONS:]:
        value = each.metrics.get(name, {}).get(metric.key)
        if value is None:
            continue
        interval = f"{number(value[1])} … {number(value[2])}" if value[1] is not None and np.isfinite(value[1]) else "–"
        remark = "" if each.digests.get(name) == result.cases[name].digest else "another case"
        verdict = each.verdicts.get(name, {}).get(metric.key, "") or remark
        rows.append((each.origin.version, each.origin.date[:10], number(value[0]), interval, verdict))
    tables = []
    if rows:
        label = f"{metric.label} [{metric.unit}]" if metric.unit else metric.label
        tables.append(Table("over the versions", ("version", "date", label, "95 %", ""), tuple(rows)))
    old, new = (each[name].measured.values[metric.key] for each in (baseline.cases, result.cases))
    sample = "piece" if result.cases[name].pieces else "drive"
    pairs = list(zip(old.tolist(), new.tolist(), strict=False))[:_DRIVES]
    columns = (sample, *(str(k) for k in range(1, len(pairs) + 1)))
    then, now = (tuple(number(each) for each in side) for side in zip(*pairs, strict=True))
    return (*tables, Table(f"{sample}s, baseline and now", columns, (("baseline", *then), ("now", *now))))


def history_panels(history: Sequence[Entry], baseline: Baseline | None, metric: Metric) -> Iterator[Panel]:
    """Draw one figure of merit over the versions, a panel per case, with 95 % intervals and the baseline."""
    last, x = history[-1], np.arange(len(history), dtype=np.float64)
    versions = [each.origin.version for each in history]
    first = [i for i, name in enumerate(versions) if i == 0 or name != versions[i - 1]]
    shown = first if len(first) <= _TICKS else [first[k] for k in np.linspace(0, len(first) - 1, _TICKS).astype(int)]
    ticks, ends = tuple((float(i), versions[i]) for i in shown), np.array([-0.5, len(history) - 0.5])
    for name, metrics in last.metrics.items():
        if metric.key not in metrics:
            continue
        curves = _versions(history, x, name, metric)
        old = None if baseline is None else baseline.cases.get(name)
        if old is not None and old.digest == last.digests.get(name) and metric.key in old.measured.values:
            level = np.full(2, metric.typical(old.measured.values[metric.key]))
            curves.insert(0, Curve("", ends, (1 + FAILS_FROM) * level, GREY, "band", (1 - FAILS_FROM) * level))
            curves.append(Curve("", ends, level, GREY, "dashed"))
        drawn = np.concatenate([edge for each in curves for edge in (each.y, each.y if each.low is None else each.low)])
        low, high = float(np.nanmin(drawn)), float(np.nanmax(drawn))
        span = high - low or abs(high) or 1.0
        limits = max(0.0, low - 0.25 * span), high + 0.15 * span
        yield Panel(name, name, "", "version", tuple(curves), "versions", limits=limits, ticks=ticks, height=135)


def _versions(history: Sequence[Entry], place: FloatArray, name: str, metric: Metric) -> list[Curve]:
    """Draw a figure of one case over the versions, with a gap where the case was changed; mark significant changes."""
    unknown = (np.nan, np.nan, np.nan)
    value = np.array([each.metrics.get(name, {}).get(metric.key, unknown) for each in history], dtype=np.float64)
    digests = [each.digests.get(name) for each in history]
    # a line of its own for each stretch of versions in which the case did not change
    starts = [0, *(i for i in range(1, len(history)) if digests[i] != digests[i - 1]), len(history)]
    curves = []
    for start, end in pairwise(starts):
        x, (middle, low, high) = place[start:end], value[start:end].T
        bars = np.column_stack((low, high, np.full(len(x), np.nan))).ravel()
        curves.append(Curve("", np.repeat(x, 3), bars, BLUE, "thin"))
        curves += [Curve("", x, middle, BLUE, "line"), Curve("", x, middle, BLUE, "points")]
    for verdict, colour in (("better", GREEN), ("worse", VERMILLION)):
        has_verdict = [each.verdicts.get(name, {}).get(metric.key) == verdict for each in history]
        # only the first version of a series with equal verdicts is marked
        begun = [i for i, now in enumerate(has_verdict) if now and not (i and has_verdict[i - 1])]
        curves.append(Curve("", place[begun], value[begun, 0], colour, "crosses"))
    return curves


def growth_panels(cases: Mapping[str, CaseResult], baseline: Baseline | None) -> list[Panel]:
    """Draw the RMS error without GPS over time, now and in the baseline, a panel per case."""
    panels: list[Panel] = []
    for name, case in cases.items():
        if not case.measured.growth[:, 0].any():
            continue
        old = None if baseline is None else baseline.cases.get(name)
        grown = [("predicted now", case.measured.growth, 2, SKY), ("now", case.measured.growth, 1, BLUE)]
        if old is not None and old.digest == case.digest:
            grown.append(("baseline", old.measured.growth, 1, BLACK))
        curves = tuple(  # only curves of the first panel have names: one legend serves all panels
            Curve(
                "" if panels else label, np.array(GROWTH), _grown(sums, i), tint, "dashed" if tint == BLACK else "line"
            )
            for label, sums, i, tint in grown
        )
        panels.append(Panel(name, name, "error [m]", "time without GPS [s]", curves, "growth", log="xy"))
    return panels


def _grown(growth: FloatArray, column: int) -> FloatArray:
    count = growth[:, 0]
    return np.sqrt(np.where(count > 0, growth[:, column] / np.maximum(count, 1.0), np.nan))


def fitted(predicted: FloatArray, actual: FloatArray) -> tuple[Any, float] | None:
    """Regress log actual on log predicted errors (n,), all above zero; None for fewer than three points.

    Returns: the line, and half the width of the 95 % interval of its slope.
    """
    from scipy.stats import linregress  # imported here, as the import is slow

    if len(predicted) < 3 or np.ptp(predicted) == 0.0:
        return None
    line = linregress(np.log10(predicted), np.log10(actual))
    return line, float(stdtrit(len(predicted) - 2, 0.975)) * line.stderr


def predicted_panels(cases: Mapping[str, CaseResult]) -> Iterator[Panel]:
    """Draw the actual error over the predicted standard deviation, with the regression line; eight points per case."""
    spreads = [case.measured.spread for case in cases.values() if case.measured.values]
    for i, (title, unit, _, names) in enumerate(GROUPS if spreads else ()):
        errors = np.sqrt(np.concatenate(spreads))[:, 3 * i : 3 * i + 3]
        usable: BoolArray = np.logical_and.reduce(np.isfinite(errors) & (errors > 0.0), axis=2)
        predicted = errors[:, :, 1][usable]
        ends = np.array([predicted.min(), predicted.max()]) if usable.any() else np.array([0.1, 1.0])
        curves = [
            Curve(name, errors[usable[:, k], k, 1], errors[usable[:, k], k, 0], colour, "points")
            for k, (name, colour) in enumerate(zip(names, AXIS_COLOURS, strict=True))
        ]
        regression, head = fitted(predicted, errors[:, :, 0][usable]), title
        curves.append(Curve("right", ends, ends, GREY))
        if regression is not None:
            line, half = regression
            curves.append(Curve("regression", ends, 10.0**line.intercept * ends**line.slope, BLACK))
            interval = f"{line.slope - half:.2f} to {line.slope + half:.2f}"
            head = f"{title}: slope {line.slope:.2f} ({interval}), R² {line.rvalue**2:.2f}"
        labels = f"actual RMS error [{unit}]", f"predicted sd [{unit}], n {len(predicted)}"
        yield Panel(title, head, *labels, tuple(curves), log="xy", height=330)
