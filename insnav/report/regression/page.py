"""Plots and pages of the accuracy over versions: PNG, one HTML page, and the section for the README."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from insnav import __version__
from insnav.exceptions import OutputError
from insnav.regression.accuracy_metrics import BY_KEY
from insnav.regression.baseline import Baseline, write_text
from insnav.regression.history import Entry
from insnav.regression.peers.run_peers import PeerRow
from insnav.regression.provenance import Origin
from insnav.regression.run_corpus import Result
from insnav.regression.verdict import Change, Comparison
from insnav.report.html import data_uri, filled
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.regression.figures import draw_growth, draw_heat, draw_history, draw_predicted
from insnav.report.regression.tables import case_table, change_text, peer_table, rules, verdict_text
from insnav.report.sheet import Sheet
from insnav.report.style import drawing, save

PAGE, SECTION = "accuracy.html", "accuracy.md"
OVER_VERSIONS = ("cep50_m", "down_rms_m", "roll_pitch_rms_deg", "heading_rms_deg", "outage_60s_m", "nees_position")
_IN_SECTION = ("accuracy_cep50_m", "accuracy_growth")


def write_pages(
    folder: Path,
    result: Result,
    history: Sequence[Entry],
    baseline: Baseline | None,
    comparison: Comparison | None,
    now: Origin,
    peers: Sequence[PeerRow] = (),
) -> list[Path]:
    """Draw everything into a folder.

    Parameters
    ----------
    folder : Path
        Made if need be; files of the same names are replaced.
    result : Result
    history : sequence of Entry
        Oldest first.
    baseline : Baseline or None
    comparison : Comparison or None
    now : Origin
    peers : sequence of PeerRow
        What other programs made of the same drives.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    OutputError
        They cannot be written.
    """
    figures: list[tuple[str, str, Callable[[], Figure | None]]] = []
    if history:
        figures += [
            (
                f"accuracy_{key}",
                f"{BY_KEY[key].label} over the versions",
                partial(draw_history, history, baseline, BY_KEY[key]),
            )
            for key in OVER_VERSIONS
        ]
    growth = partial(draw_growth, result.cases, baseline)
    figures.append(("accuracy_growth", "Error without GPS, now and in the baseline", growth))
    predicted = partial(draw_predicted, result.cases)
    figures.append(("accuracy_predicted", "Actual error against the one predicted", predicted))
    if comparison is not None:
        figures.append(("accuracy_change", "Change of every figure since the baseline", partial(draw_heat, comparison)))
    pictures: list[tuple[str, str, Path]] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with drawing():
            for name, caption, draw in figures:
                figure = draw()
                if figure is not None:
                    pictures.append((name, caption, save(figure, folder / name, "png")))
    except OSError as error:
        raise OutputError("the plots cannot be written", where=str(folder), why=error.strerror or str(error)) from error
    sheet = _sheet(result, baseline, comparison, now, peers)
    shown = [(caption, data_uri(file)) for _, caption, file in pictures]
    write_text(folder / PAGE, filled("sheet.html.j2", sheet=sheet, pictures=shown, version=__version__))
    names = {name: (caption, file.name) for name, caption, file in pictures}
    chosen = [names[key] for key in _IN_SECTION if key in names]
    write_text(folder / SECTION, section(result, comparison, now, peers, chosen))
    return [*(file for _, _, file in pictures), folder / PAGE, folder / SECTION]


def _sheet(
    result: Result,
    baseline: Baseline | None,
    comparison: Comparison | None,
    now: Origin,
    peers: Sequence[PeerRow],
) -> Sheet:
    summary = [_where(now)]
    tables = [case_table(result, comparison)]
    warnings: list[str] = []
    if comparison is not None and baseline is not None:
        summary.append(verdict_text(comparison, baseline.origin))
        warnings += [f"fails: {change_text(change)}" for change in comparison.failing]
        warnings += [f"broken: {name}: {why}" for name, why in comparison.broken.items()]
        changed = [change for change in comparison.changes if change.verdict != "same"]
        if changed:
            rows = tuple(_changed(change) for change in changed)
            columns = ("case", "figure", "then", "now", "change [%]", "p, corrected", "")
            tables.append(Table("Figures that changed", columns, rows))
        warnings += [f"not compared: {name}: {why}" for name, why in comparison.apart.items()]
    if peers:
        tables.append(peer_table(peers))
    skipped = [f"skipped: {name}: {why}" for name, why in result.skipped.items()]
    return Sheet("insnav: accuracy over versions", tuple(summary), tuple(tables), (), rules(), (*warnings, *skipped))


def _changed(change: Change) -> tuple[str, ...]:
    percent = f"{100.0 * change.shift.change:+.1f}"
    then, now = number(change.old), number(change.new)
    return change.case, change.metric.label, then, now, percent, f"{change.adjusted:.1g}", change.verdict


def section(
    result: Result,
    comparison: Comparison | None,
    now: Origin,
    peers: Sequence[PeerRow],
    pictures: Sequence[tuple[str, str]],
) -> str:
    """Write the section for the README: plots and tables in Markdown.

    Parameters
    ----------
    result : Result
    comparison : Comparison or None
    now : Origin
    peers : sequence of PeerRow
    pictures : sequence of (str, str)
        Caption and file name.
    """
    lines = ["# Accuracy on the corpus", "", _where(now), ""]
    for caption, name in pictures:
        lines += [f"![{caption}]({name})", ""]
    tables = [case_table(result, comparison), *([peer_table(peers)] if peers else [])]
    for table in tables:
        lines += [f"## {table.title}", "", *_markdown(table), "", table.note, ""]
    return "\n".join([*lines, *(f"- {rule}" for rule in rules()), ""])


def _markdown(table: Table) -> list[str]:
    def line(cells: Sequence[str]) -> str:
        return f"| {' | '.join(cells)} |"

    rule = line(["---", *("---:" for _ in table.columns[1:])])
    return [line(table.columns), rule, *(line(row) for row in table.rows)]


def _where(now: Origin) -> str:
    commit = f", commit {now.commit}" if now.commit else ""
    return f"Version {now.version}{commit}, {now.date}, {now.computer}; made by `insnav regress --peers --plot`."
