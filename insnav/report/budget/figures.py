"""The error budget on two pages of A4: the result, growth and contributions; tables and assumptions."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from insnav.report.colours import BLACK, GREY
from insnav.report.figures import blank, draw_panel
from insnav.report.page import Table, Verdict
from insnav.report.panels import Panel
from insnav.report.pdf import HEIGHT, LIGHT_COLOURS, WIDTH

_LEFT, _RIGHT = 0.7, 0.25  # margins [inch]
_ROW, _NOTE = 0.158, 0.142  # heights [inch]
_TITLE = 70  # characters of the title
_NOTE_WIDTH = 150  # characters in a line of the notes


def draw_front(panels: Sequence[Panel], motion: str, title: str, verdict: Verdict, estimates: Table) -> Figure:
    """Draw the first page: result, four estimates, growth, sources, contributions.

    `panels`: of the page.
    """
    short = textwrap.shorten(title, _TITLE, placeholder="…")
    figure = blank(WIDTH, HEIGHT, short, textwrap.fill(f"Motion: {motion}.", 115))
    figure.text(0.2 / WIDTH, 1.0 - 0.8 / HEIGHT, textwrap.fill(verdict.sentence, 84), va="top", fontsize=11.0)
    light = f"{verdict.light}: {verdict.reason}"
    figure.text(0.2 / WIDTH, 1.0 - 1.55 / HEIGHT, light, va="top", fontsize=8.5, color=LIGHT_COLOURS[verdict.light])
    place, high, width = partial(_place, figure), _ROW * (len(estimates.rows) + 3), WIDTH - _LEFT - _RIGHT
    low = HEIGHT - 1.8 - high
    widths = (0.8, *(1.3 if "(" in text else 0.9 for text in estimates.rows[-1][1:]))
    _write_table(place(0.2, WIDTH - 0.4, low, high), estimates, widths)
    wanted = {panel.key: panel for panel in panels}
    for key, axes, letters in (
        ("growth", place(_LEFT, width, low - 3.9, 3.3), 62),
        ("sources", place(_LEFT, 0.45 * width, low - 7.9, 3.1), 24),
        ("contributions", place(_LEFT + 0.72 * width, 0.28 * width, low - 7.9, 3.1), 12),
    ):
        draw_panel(axes, wanted[key], letters=letters)
        axes.set_xlabel(textwrap.fill(wanted[key].x_label, 40))
        axes.tick_params(axis="y", labelsize=7.5)
    return figure


def draw_back(title: str, tables: Sequence[Table], widths: Sequence[Sequence[float]], notes: Sequence[str]) -> Figure:
    """Draw the second page: tables with given column widths, and notes as space permits."""
    figure = blank(WIDTH, HEIGHT, title, "")
    place, low = partial(_place, figure), HEIGHT - 0.5
    for table, wide in zip(tables, widths, strict=True):
        high = _ROW * (len(table.rows) + 3)
        low -= high
        _write_table(place(0.2, WIDTH - 0.4, low, high), table, wide)
    lines = [line for text in notes for line in textwrap.wrap(text, _NOTE_WIDTH, subsequent_indent="   ")]
    room = max(int((low - 0.3) / _NOTE) - 2, 1)
    if len(lines) > room:
        lines = [*lines[: room - 1], "… more in report.html"]
    high = _NOTE * (len(lines) + 2)
    axes = place(0.2, WIDTH - 0.4, low - high, high)
    axes.set_axis_off()
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(len(lines) + 2, 0.0)
    axes.text(0.0, 0.5, "Reading guide and assumptions", fontsize=9.0, fontweight="bold", va="center")
    for row_number, line in enumerate(lines):
        axes.text(0.0, 1.6 + row_number, line, fontsize=7.2, va="center")
    return figure


def _place(figure: Figure, left: float, wide: float, bottom: float, high: float) -> Axes:
    """Add axes by left edge, width, bottom edge and height [inch]."""
    return figure.add_axes((left / WIDTH, bottom / HEIGHT, wide / WIDTH, high / HEIGHT))


def _write_table(axes: Axes, table: Table, widths: Sequence[float]) -> None:
    """Write a table into a panel: title, headings, rows; numbers right-aligned, the first column left-aligned."""
    axes.set_axis_off()
    count = len(table.rows) + 3
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(count, 0.0)
    edges = np.concatenate([[0.0], np.cumsum(widths) / np.sum(widths)])
    axes.text(0.0, 0.45, table.title, fontsize=9.0, fontweight="bold", va="center")
    axes.plot([0.0, 1.0], [2.05, 2.05], color=GREY, linewidth=0.8)
    for row_number, row in enumerate((table.columns, *table.rows)):
        y = 1.5 + row_number + (0.1 if row_number else 0.0)
        for column, text in enumerate(row):
            first = column == 0
            x = edges[0] if first else edges[column + 1] - 0.004
            style = "#444444" if row_number == 0 else BLACK
            axes.text(x, y, text, fontsize=7.2, color=style, ha="left" if first else "right", va="center")
        if row_number % 2:
            axes.axhspan(y - 0.5, y + 0.5, color="#F2F2F2", linewidth=0.0, zorder=0.0)
