"""PDF report of a few A4 pages: verdict and figures of merit first, then figures under page titles."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from insnav.plain_text import plain_text
from insnav.report.figures import drawing
from insnav.report.page import FigureSpec, Page, cell
from insnav.report.style import GREEN, GREY, ORANGE, VERMILLION
from insnav.version import __version__

WIDTH, HEIGHT, _MARGIN = 8.27, 11.69, 0.6  # A4 [inch]
_DPI = 200
_LINE = 0.19  # height of a line of text [inch]
_LETTERS = 92  # characters per line of text
_ROWS = 95  # lines of tables per page
LIGHT_COLOURS = {"good": GREEN, "attention": ORANGE, "bad": VERMILLION, "unknown": GREY}


def write_pdf(page: Page, file: Path, pages: Mapping[str, Sequence[str]], lines: Sequence[str] = ()) -> None:
    """Write a report as PDF: pages of figures, with the verdict and the figures of merit on the first, then tables.

    `pages`: names of the figures by page title; a page shows the first two of them that the report contains.
    `lines`: text lines of the tables.
    """
    head = (HEIGHT - _MARGIN) / HEIGHT
    figure_of = {each.name: each for each in page.figures}
    with drawing(), PdfPages(file, metadata={"CreationDate": None, "Creator": None, "Producer": None}) as pdf:
        for number, (title, names) in enumerate(pages.items(), 1):
            sheet = Figure(figsize=(WIDTH, HEIGHT))
            short = textwrap.shorten(plain_text(f"{page.title}: {title}"), 70, placeholder="…")
            sheet.text(_MARGIN / WIDTH, head, short, va="top", fontsize=14.0, fontweight="bold")
            top = HEIGHT - _MARGIN - 0.4
            if number == 1:
                top = _first(sheet, page, top)
            _figures(sheet, [figure_of[name] for name in names if name in figure_of][:2], top)
            foot = f"insnav {__version__}   page {number} of {len(pages) + -(-len(lines) // _ROWS)}"
            sheet.text(0.5, 0.35 / HEIGHT, foot, ha="center", fontsize=8.0, color="#555555")
            pdf.savefig(sheet)
        for first in range(0, len(lines), _ROWS):
            sheet, text = Figure(figsize=(WIDTH, HEIGHT)), "\n".join(lines[first : first + _ROWS])
            sheet.text(_MARGIN / WIDTH, head, text, va="top", fontsize=6.5, family="monospace")
            pdf.savefig(sheet)


def _first(sheet: Figure, page: Page, top: float) -> float:
    """Write verdict, summary, warnings and figures of merit below the height `top`; return their lower edge [inch]."""
    left = _MARGIN / WIDTH
    lines: list[tuple[str, str]] = []
    if page.verdict is not None:
        lines += [(page.verdict.rating, LIGHT_COLOURS[page.verdict.light]), (page.verdict.sentence, "#000000")]
    lines += [(text, "#000000") for text in page.summary]
    lines += [(f"! {text}", VERMILLION) for text in page.warnings]
    for text, colour in lines:
        for row in textwrap.wrap(plain_text(text), _LETTERS):
            sheet.text(left, top / HEIGHT, row, va="top", fontsize=9.5, color=colour)
            top -= _LINE
    top -= 0.5 * _LINE
    width = (WIDTH - 2.0 * _MARGIN) / 3.0
    for i, each in enumerate(page.merits):
        x, y = (_MARGIN + width * (i % 3)) / WIDTH, top - 0.45 * (i // 3)
        sheet.text(x, y / HEIGHT, each.label, va="top", fontsize=8.0, color="#555555")
        sheet.text(x, (y - 0.15) / HEIGHT, f"{cell(each)} {each.shown_unit}", va="top", fontsize=12.0)
    return top - 0.45 * -(-len(page.merits) // 3) - 0.1


def _figures(sheet: Figure, figures: Sequence[FigureSpec], top: float) -> None:
    """Place figures below one another from the height `top` down [inch], with equal widths, as large as they fit."""
    images = [_image(each) for each in figures]
    aspects = [image.shape[0] / image.shape[1] for image in images]
    room = top - _MARGIN - 0.1
    width = min(WIDTH - 2.0 * _MARGIN, room / sum(aspects)) if aspects else 0.0
    for image, aspect in zip(images, aspects, strict=True):
        height = width * aspect
        axes = sheet.add_axes((0.5 - 0.5 * width / WIDTH, (top - height) / HEIGHT, width / WIDTH, height / HEIGHT))
        axes.imshow(image, interpolation="lanczos", aspect="auto")
        axes.set_axis_off()
        top -= height


def _image(figure: FigureSpec) -> np.ndarray:
    drawn = figure.draw()
    drawn.set_dpi(_DPI)
    image, (width, height) = FigureCanvasAgg(drawn).print_to_buffer()  # type: ignore[no-untyped-call]
    return np.frombuffer(image, np.uint8).reshape(height, width, 4)[:, :, :3]
