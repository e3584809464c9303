"""One sheet of results: a few tables and figures, for the terminal and as a page. Every bench method makes one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from insnav import __version__
from insnav.exceptions import ConfigError
from insnav.output.folder import RunFolder
from insnav.plain_text import plain_text
from insnav.report.html import data_uri, filled
from insnav.report.page import Table
from insnav.report.style import FigureFormat, drawing, save
from insnav.report.terminal import table_text


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure drawn inside `drawing`, the name of its file without suffix, and what it shows."""

    name: str
    figure: Figure
    caption: str


@dataclass(frozen=True, slots=True)
class Sheet:
    """Everything on one page.

    Attributes
    ----------
    title : str
        What was done, to what.
    summary : tuple of str
        The result in a few sentences.
    tables : tuple of Table
    pictures : tuple of Picture
    assumptions : tuple of str
        What was taken for granted: defaults, validity, sources.
    warnings : tuple of str
        What the reader must not overlook.
    """

    title: str
    summary: tuple[str, ...]
    tables: tuple[Table, ...]
    pictures: tuple[Picture, ...] = ()
    assumptions: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def sheet_text(sheet: Sheet) -> str:
    """Write a sheet for the terminal: title, summary, tables in columns, warnings, assumptions.

    Parameters
    ----------
    sheet : Sheet
    """
    blocks = ["\n".join([sheet.title, *sheet.summary])]
    blocks += [table_text(table) for table in sheet.tables]
    for heading, lines in (("Warnings", sheet.warnings), ("Assumptions", sheet.assumptions)):
        if lines:
            blocks.append("\n".join([heading, *(f"  - {line}" for line in lines)]))
    return "\n".join(plain_text(line) for line in "\n\n".join(blocks).splitlines())


def write_sheet(
    folder: RunFolder,
    sheet: Sheet,
    facts: Mapping[str, Any],
    texts: Mapping[str, str] | None = None,
    figure_format: FigureFormat = "png",
) -> Path:
    """Write figures, page and text files into a folder and put it in its place.

    Parameters
    ----------
    folder : RunFolder
        Entered, not committed.
    sheet : Sheet
        Content of ``report.html``.
    facts : mapping
        Content of ``run.json``, JSON-ready.
    texts : mapping, optional
        Further files: name to content, such as ``calibration.toml``.
    figure_format : {"png", "svg"}

    Returns
    -------
    Path
        The finished folder.

    Raises
    ------
    ConfigError
        Two pictures, or two files, of one name.
    OutputError
        The folder cannot be written.
    """
    names = [picture.name for picture in sheet.pictures]
    if len(set(names)) < len(names):
        raise ConfigError("two figures have the same name", where=", ".join(names))
    with drawing():
        files = [save(p.figure, folder.path(f"figures/{p.name}"), figure_format) for p in sheet.pictures]
    for name, text in (texts or {}).items():
        folder.path(name).write_text(text, encoding="utf-8", newline="\n")
    pictures = [(picture.caption, data_uri(file)) for picture, file in zip(sheet.pictures, files, strict=True)]
    page = filled("sheet.html.j2", page=sheet, tables=sheet.tables, pictures=pictures, version=__version__)
    folder.path("report.html").write_text(page, encoding="utf-8", newline="\n")
    return folder.commit(facts)
