"""``insnav report``: page and figures of a run again, from its folder."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import options as opt
from insnav.cli.console import files_line, quiet_figures, result, result_facts

SHORT_HELP = "Page and figures of a run again, from its folder."
HELP = """Page and figures of a run again, from its folder.

Reads what `insnav run` has written and makes a new folder with figures and page from it, such as in another format or
by another version of insnav. Nothing is navigated.

\b
Examples:
  insnav report run
  insnav report run --figures svg --out run_svg
  insnav report run --pdf                       run.pdf, three pages
"""


class Figures(StrEnum):
    """File format of the figures."""

    png = "png"
    svg = "svg"


def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.", rich_help_panel=opt.FILES)],
    figures: Annotated[
        Figures, typer.Option(metavar="FORMAT", help="Figures as png or svg.", rich_help_panel=opt.RESULT)
    ] = Figures.png,
    out: opt.Out = Path("report"),
    force: opt.Force = False,
    pdf: Annotated[
        bool,
        typer.Option("--pdf", help="Only a PDF of three pages, RUN.pdf beside the folder.", rich_help_panel=opt.RESULT),
    ] = False,
    as_json: opt.Json = False,
) -> None:
    """Draw a run again."""
    from insnav.result import open_result

    opened = open_result(run)
    quiet_figures()
    if pdf:
        from insnav.report.save import write_result_pdf

        file = run.resolve().with_name(f"{run.resolve().name}.pdf")
        write_result_pdf(opened, file)
        result(f"files: {file}")
        return
    where = opened.save(out, force=force, figures=figures.value)
    if as_json:
        result_facts(where)
    else:
        result(f"{opened.summary()}\n{files_line(where, out)}")
