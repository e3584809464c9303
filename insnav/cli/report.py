"""``insnav report``: page and figures of a stored result."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from insnav.cli.console import brief_text, files_line, quiet_figures, result, result_facts
from insnav.cli.options import RESULT, Backdrop, Force, Json, argument, flag, option
from insnav.exceptions import ConfigError

if TYPE_CHECKING:
    from insnav.result import Result


def report(
    run: Annotated[Path, argument("RUN", "Folder of a run, outage test or budget.")],
    figures: Annotated[Literal["png", "svg"], option(RESULT, "FORMAT", "Figures as png or svg.")] = "png",
    backdrop: Backdrop = None,
    out: Annotated[Path | None, option(RESULT, "FOLDER", "Folder to make; default RUN_report next to RUN.")] = None,
    force: Force = False,
    pdf: Annotated[bool, flag(RESULT, "--pdf", "Only a PDF of three pages, RUN.pdf next to the folder.")] = False,
    as_json: Json = False,
) -> None:
    """Draw a run again."""
    from insnav.result import open_result

    opened, whole = open_result(run), run.resolve()
    quiet_figures()
    opened = with_backdrop(opened, backdrop)
    if pdf:
        from insnav.report.save import write_result_pdf

        file = whole.with_name(f"{whole.name}.pdf")
        write_result_pdf(opened, file)
        result(f"files: {file}")
        return
    out = out or whole.with_name(f"{whole.name}_report")
    where = opened.save(out, force=force, figures=figures)
    if as_json:
        result_facts(where)
    else:
        result(f"{brief_text(opened)}\n{files_line(where, out)}")


def with_backdrop(opened: Result[Any], file: Path | None) -> Result[Any]:
    """Add the lines of a file to the background of a run's map, if any."""
    if file is None:
        return opened
    from insnav.report.run.page import read_backdrop

    if opened.kind != "run":
        raise ConfigError("cli.no_map", where="--backdrop", kind=opened.kind)
    return replace(opened, found=replace(opened.found, backdrop=read_backdrop(file)))
