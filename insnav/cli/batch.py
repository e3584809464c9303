"""``insnav batch``: many drives with one command, each as ``insnav run`` navigates it."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from insnav.cli import console
from insnav.cli.console import Stages, Stopped, note, quiet_figures, result_page
from insnav.cli.data_options import check_usable
from insnav.cli.options import usage_error
from insnav.exceptions import ConfigError, InsnavError, OutputError

if TYPE_CHECKING:
    from insnav.findings import Finding
    from insnav.fleet.batch import Drive

SETTINGS = {"ignore_unknown_options": True, "allow_extra_args": True}  # options of insnav run are allowed
_COLUMNS = ("drive", "vehicle", "result", "horizontal_error", "horizontal_sd", "rejected", "outlier")


def batch(
    context: typer.Context,
    drives: Path,
    out: Path = Path("fleet"),
    again: bool = False,
    engine: str = "processes",
    as_json: bool = False,
) -> None:
    """Navigate many drives."""
    if str(drives).startswith("-"):
        raise ConfigError("cli.drives_first", where=str(drives))
    common = _absolute(context.args, Path())
    _parsed(["imu.csv", *common], "options for all drives")
    with Stages() as stage:
        stage("finding")
        from insnav.fleet.batch import batch as navigated
        from insnav.fleet.batch import check_folder, find_drives, moved_aside
        from insnav.messages import sentence
        from insnav.output.folder import resolved
        from insnav.report.fleet.page import nonempty_columns, write_fleet
        from insnav.result import Result

        quiet_figures()
        folder = resolved(out)
        check_folder(folder)
        skipped: list[Finding] = []
        recordings = _read(drives) if drives.suffix.lower() == ".toml" else None
        if recordings is None:
            recordings, skipped = find_drives(drives, folder, "processes" if "dask" in engine else engine)
        recordings = [replace(job, arguments=(job.arguments[0], *common, *job.arguments[1:])) for job in recordings]
        try:
            outcomes = navigated(
                run_drive,
                recordings,
                folder,
                again=again,
                workers=engine,
                progress=lambda done: stage("navigating", done / len(recordings), len(recordings)),
            )
        except Stopped:
            note("finished drives are kept: the same command continues")
            raise
        stage("writing")
        aside = moved_aside(folder)
        for text in (*map(sentence, aside), *(f"{run.name}: {run.failed.reason}" for run in outcomes if run.failed)):
            note(text)
        options, findings = {"drives": str(drives), "run": common}, (*skipped, *aside)
        outcome = Result("fleet", tuple(outcomes), options=options, findings=findings)
        write_fleet(folder, outcome)
    page = outcome.page()
    rows = nonempty_columns([[cell for cell in row if cell.key in _COLUMNS] for row in page.sections[1].rows])
    shown = replace(page, sections=(replace(page.sections[1], rows=rows),))
    result_page(folder, page if console.level > 0 else shown, out, as_json=as_json, more=("drives", "fleet.csv"))
    unwritten = [run.failed for run in outcomes if isinstance(run.failed, OutputError)]
    if unwritten:
        raise OutputError("batch.unwritten", where=str(folder), count=len(unwritten), cause=unwritten[0])
    check_usable(outcome)


def run_drive(arguments: Sequence[str]) -> None:
    """Navigate one drive as ``insnav run`` does, without output; errors are raised."""
    from insnav.cli import _run
    from insnav.cli.data_options import as_option

    level, console.level = console.level, -1
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            _run(["run", *arguments])
    except InsnavError as error:
        error.where = as_option(error.where)
        raise
    finally:
        console.level = level


def _read(path: Path) -> list[Drive]:
    """Read the drives listed in a TOML file; paths in it are relative to its folder."""
    from insnav.config_file import read_toml
    from insnav.fleet.batch import Drive, name_of

    content = read_toml(path)
    tables = content.get("drive")
    if content.keys() != {"drive"} or not isinstance(tables, list) or not tables:
        raise ConfigError("cli.no_drives", where=str(path), found=tuple(content))
    drives = []
    for number, table in enumerate(tables, start=1):
        where = f"{path}: drive {number}"
        if not isinstance(table, dict) or "file" not in table:
            raise ConfigError("cli.drive_without_file", where=where)
        if "out" in table:
            raise ConfigError("cli.drive_with_folder", where=f"{where}: out")
        words = [word for key, value in table.items() for word in _words(key, value)]
        file, *options = _absolute([str(table["file"]), *words], path.parent)
        _parsed([file, *options], where)
        name = name_of(str(table.get("name") or Path(file).parent.name)) or f"drive{number}"
        file = str((path.parent / file).absolute())
        drives.append(Drive(name, str(table.get("vehicle", "")), (file, *options)))
    return drives


def _words(key: str, value: Any) -> list[str]:
    """Convert one key of a drive's table to command-line words."""
    option = f"--{key.replace('_', '-')}"
    if key in ("file", "name", "vehicle"):
        return []
    if isinstance(value, bool):
        return [option if value else option.replace("--", "--no-", 1)]
    if isinstance(value, dict):
        value = [f"{name}={header}" for name, header in value.items()]
    return [option, ",".join(map(str, value)) if isinstance(value, list) else str(value)]


def _absolute(words: Sequence[str], folder: Path) -> list[str]:
    """Make file names absolute, for any worker; split ``--imu=FILE``, so that a change of the file is noticed."""
    absolute: list[str] = []
    for word in words:
        option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
        place = folder / value
        absolute += [*([option] if equals else []), str(place.absolute())] if value and place.is_file() else [word]
    return absolute


def _parsed(arguments: list[str], where: str) -> None:
    """Refuse options unknown to insnav run, before the first drive is navigated."""
    from insnav.cli import commands

    try:
        commands("run").commands["run"].make_context("insnav run", list(arguments))
    except Exception as error:
        if not hasattr(error, "format_message"):
            raise
        raise ConfigError("cli.run_options", where=where, cause=usage_error(error)) from None
