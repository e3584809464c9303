"""``insnav report``: page and figures of a result again, from its folder."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from insnav.cli import options as opt
from insnav.cli.console import brief_text, files_line, quiet_figures, result, result_facts

if TYPE_CHECKING:
    from insnav.result import Result

SHORT_HELP = "Page and figures of a run, outage test or budget again, from its folder."
HELP = """Page and figures of a run, an outage test or a budget again, from its folder.

Reads what `insnav run`, `outage` or `budget` has written and makes a new folder with figures and page from it, such as
in another format or by another version of insnav. Nothing is navigated.

\b
Examples:
  insnav report run
  insnav report run --figures svg --out run_svg
  insnav report run --pdf                       run.pdf, three pages
  insnav report run --backdrop streets.geojson  lines behind the track
  insnav report budget --out budget_figures
"""


class Figures(StrEnum):
    """File format of the figures."""

    png = "png"
    svg = "svg"


def report(
    run: Annotated[
        Path,
        typer.Argument(metavar="RUN", help="Folder of a run, outage test or budget.", rich_help_panel=opt.FILES),
    ],
    figures: Annotated[
        Figures, typer.Option(metavar="FORMAT", help="Figures as png or svg.", rich_help_panel=opt.RESULT)
    ] = Figures.png,
    backdrop: opt.Backdrop = None,
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
    if backdrop is not None:
        opened = _with_backdrop(opened, backdrop)
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
        result(f"{brief_text(opened)}\n{files_line(where, out)}")


def _with_backdrop(opened: Result[Any], file: Path) -> Result[Any]:
    from dataclasses import replace

    from insnav.exceptions import ConfigError
    from insnav.report.run.backdrop import read_backdrop

    if opened.kind != "run":
        raise ConfigError(f"a result of kind {opened.kind} has no map", where="--backdrop")
    return replace(opened, found=replace(opened.found, backdrop=read_backdrop(file)))
