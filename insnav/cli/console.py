"""What the user sees: results on standard output, progress and errors on standard error."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import shutil
import sys
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TextIO

from insnav import progress
from insnav.cli import signals
from insnav.exceptions import InsnavError, OutputError, reason_of

if TYPE_CHECKING:
    from insnav.output.folder import RunFolder
    from insnav.report.page import Page, Show
    from insnav.result import Result

# where there is no terminal, after this, twice, four times this and so on a line says what is being done [s]
LOGGED = 15.0
WIDTH = 110  # of a line of the log where no terminal says another
CLEARED = "\r\x1b[K"  # the line of a terminal that shows the progress
_COLOURS = {"light.good": 32, "light.attention": 33, "light.bad": 31, "run.warning": 33}  # of the terminal


level = 0  # of detail: -1 nothing but errors, 0 what matters, 1 everything


def result(text: str, *, always: bool = False) -> None:
    """Print what was asked for, on standard output.

    `always`: also where the user wants nothing printed, as he asked for this.

    Raises: OutputError: standard output takes no more, such as a file on a full disk; BrokenPipeError: its reader went
    away.
    """
    if level < 0 and not always:
        return
    try:
        print(text, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        discard_output()
        raise OutputError("cli.output_unwritable", where="standard output", reason=reason_of(error)) from error


def result_facts(folder: Path) -> None:
    """Print the facts of a finished folder, on standard output.

    `folder`: with its ``run.json``.
    """
    from insnav.output.folder import FACTS_FILE

    result((folder / FACTS_FILE).read_text(encoding="utf-8").rstrip("\n"), always=True)


def files_line(folder: Path, out: Path) -> str:
    """Say what a finished folder holds, each folder in it once, what people read first.

    `folder`: with its ``run.json``. `out`: as it was named.
    """
    from insnav.messages import phrase
    from insnav.output.folder import read_facts

    found = {name.split("/")[0] for name in read_facts(folder).get("files", {})} | {"run.json"}
    first = [name for name in ("report.html", "figures", "run.json") if name in found]
    others = len(found) - len(first)
    return phrase("terminal.files", folder=out, names=", ".join(first), others=others)


def result_page(folder: Path, page: Page, out: Path, *, as_json: bool, more: Iterable[str] = ()) -> None:
    """Print the report of a finished folder and where it is, or its ``run.json`` instead.

    `folder`: with its ``run.json``.
    """
    if as_json:
        result_facts(folder)
        return
    from insnav.report.terminal import page_text

    wanted = (*more, "report.html", "figures", "run.json")
    names = ", ".join(name for name in wanted if (folder / name).exists())
    shown: tuple[Show, ...] = ("all", "page") if level > 0 else ("all",)
    result(coloured(f"{page_text(page, terminal_width(), shown)}\n\nfiles       {out}: {names}"))


def write_result(outcome: Result[Any], folder: RunFolder, stage: Stages, **how: Any) -> Path:
    """Write a result into its folder, and give the finished folder.

    `how`: as of `insnav.report.save.save_result`.
    """
    stage("writing")
    from insnav.report.save import save_result

    quiet_figures()
    return save_result(outcome, folder, **how)


def brief_text(found: Result[Any]) -> str:
    """Sum up a result: lines of the width of the terminal; elsewhere nothing is wrapped."""
    from insnav.report.save import text_of

    return text_of(found, terminal_width())


def terminal_width() -> int | None:
    """Columns of the terminal that results are printed on; none where they go elsewhere."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def coloured(text: str) -> str:
    """Colour the words at the start of a line that say how good a result is, on a terminal that takes colours."""
    if not sys.stdout.isatty() or os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return text
    from insnav.messages import phrase

    for name, colour in _COLOURS.items():
        words = phrase(name)
        text = re.sub(rf"^{words}(?=[: (：（])", f"\x1b[{colour}m{words}\x1b[0m", text, flags=re.MULTILINE)
    return text


def quiet_figures() -> None:
    """Keep the care of matplotlib for its own cache out of the log."""
    import logging

    logging.getLogger("matplotlib").setLevel(logging.ERROR)


def discard_output() -> None:
    """Let what is still to be printed vanish, also what the interpreter flushes at its end."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def error_block(error: InsnavError) -> None:
    """Print one error: what, and where, why, how to mend it, and its code."""
    from insnav.messages import form

    lines = [f"insnav: {form('error')} {_plain(error.what)}"]
    lines += [f"  {label} {_plain(text)}" for label, text in error.details() if text]
    if sys.stderr.isatty():
        from insnav.plain_text import wrapped

        width, rows = shutil.get_terminal_size().columns, "\n".join(lines).splitlines()
        lines = [part for row in rows for part in wrapped(row, width, subsequent_indent=" " * 9)]
    print("\n".join(lines), file=sys.stderr, flush=True)


def note(text: str) -> None:
    """Print one entry of the log."""
    if level >= 0:
        _log(text, "insnav: ")


def note_warnings(found: Result[Any]) -> None:
    """Print the warnings of a result in the log."""
    from insnav.findings import Severity
    from insnav.messages import sentence

    for each in found.findings:
        if each.severity >= Severity.WARNING:
            note(sentence(each))


def detail(text: str, *more: str) -> None:
    """Print one entry of the log with what belongs to it, for those who want to know everything."""
    if level > 0:
        _log(text, "insnav: ")
        for each in more:
            _log(each, "        ")


def _log(text: str, lead: str, stream: TextIO | None = None) -> None:
    from insnav.plain_text import wrapped

    body = _plain(text)
    width = shutil.get_terminal_size((WIDTH, 0)).columns
    lines = wrapped(
        body, width, initial_indent=lead, subsequent_indent=" " * 10, break_long_words=False, break_on_hyphens=False
    )
    stream = stream or sys.stderr
    print(CLEARED * stream.isatty() + "\n".join(lines), file=stream, flush=True)


def _plain(text: str) -> str:
    from insnav.plain_text import plain_text, without_exponents

    return "\n         ".join(plain_text(line) for line in without_exponents(text).splitlines())


@contextlib.contextmanager
def working(out: Path, force: bool | Literal["keep"]) -> Iterator[tuple[RunFolder, Stages]]:
    """Folder that a command makes, which is complete in the end or absent, and the stages of its work."""
    from insnav.output.folder import RunFolder

    with RunFolder(out, force=force) as folder, Stages() as stage:
        yield folder, stage
    if folder.kept is not None:
        from insnav.messages import phrase

        note(phrase("terminal.kept", folder=folder.kept.name))


class Stages(progress.Stages):
    """Shows it on a terminal in a line that is redrawn, else by a line of the log now and then.

    Use it inside the context manager that removes what is half written.
    """

    def __init__(self) -> None:
        stream = sys.stderr  # that of now: a drive of a fleet is navigated without a word
        if stream.isatty():
            waits: Iterable[float] = itertools.chain((progress.DELAY,), itertools.repeat(progress.REDRAWN))
        else:
            waits = (LOGGED * 2.0 ** max(count - 1, 0) for count in itertools.count())
        super().__init__(partial(_show, stream), waits if level >= 0 else ())

    def __exit__(self, *error: object) -> None:
        signals.arrived()
        super().__exit__(*error)


def _show(stream: TextIO, line: str) -> None:
    """Show a line in the place of the one before, or in a log."""
    if stream.isatty():
        print(CLEARED + line[: shutil.get_terminal_size().columns - 1], end="", file=stream, flush=True)
    elif line:
        _log(line, "insnav: ", stream)
