"""What all figures for papers share: type, margins, axes, legends, files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from insnav.messages import speaking

FigureFormat = Literal["png", "svg", "pdf"]

DOTS_PER_INCH = 130
_LONG = 1e4  # ends of a logarithmic axis so far apart have no room for more than powers of ten

_RC: Any = mpl.rc_params_from_file(Path(__file__).with_name("papers.mplstyle"), use_default_template=False)


@contextmanager
def drawing() -> Iterator[None]:
    """Set the style of everything drawn inside, and English words: the font has no others."""
    with mpl.rc_context(_RC), speaking("en"):
        yield


def blank(width: float, height: float, title: str, note: str) -> Figure:
    """Start an empty figure, size in [inch], with its headline, a quieter note on how to read it, and margins."""
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    # Fixed margins: measuring them would draw everything twice.
    figure.subplots_adjust(left=0.85 / width, right=1.0 - 0.2 / width, bottom=0.55 / height, top=1.0 - 0.85 / height)
    left = 0.15 / width
    figure.text(left, 1.0 - 0.12 / height, title, ha="left", va="top", fontsize=11.5, fontweight="bold")
    figure.text(left, 1.0 - 0.36 / height, note, ha="left", va="top", fontsize=8.5, color="#444444")
    return figure


def save(figure: Figure, path: Path, file_format: FigureFormat) -> Path:
    """Write a figure to a path without suffix, and return the file."""
    file = path.with_name(f"{path.name}.{file_format}")
    if file_format == "svg":
        figure.savefig(file, metadata={"Date": None, "Creator": None})
    elif file_format == "pdf":
        figure.savefig(file, metadata={"CreationDate": None, "Creator": None, "Producer": None})
    else:
        # Light compression: the files grow by a fifth and are written in half the time.
        figure.savefig(file, dpi=DOTS_PER_INCH, metadata={"Software": None}, pil_kwargs={"compress_level": 3})
    return file


def save_pages(figures: Sequence[Figure], file: Path) -> Path:
    """Write figures into one PDF, a page each; the same figures give the same bytes."""
    with PdfPages(file, metadata={"CreationDate": None, "Creator": None, "Producer": None}) as pages:
        for figure in figures:
            pages.savefig(figure)
    return file


def logarithmic(axis: Axis) -> None:
    """Mark a logarithmic axis at 1, 2 and 5 of each power of ten, a long one at powers, as plain numbers."""
    low, high = sorted(axis.get_view_interval())
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < _LONG * low else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def legend_above(axes: Axes, *others: Axes, lift: float = 1.0) -> None:
    """Put the legend on one line over the upper right corner of a panel, out of the way of the data.

    `lift`: height of the legend's lower edge in heights of the panel.
    """
    entries: dict[str, Any] = {}
    for panel in (axes, *others):
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if entries:
        axes.legend(
            handles=list(entries.values()),
            labels=list(entries),
            loc="lower right",
            bbox_to_anchor=(1.0, lift),
            ncols=len(entries),
            borderaxespad=0.1,
            handlelength=1.4,
            columnspacing=1.2,
        )
