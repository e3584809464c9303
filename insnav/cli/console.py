"""What the user sees: results on standard output, progress and errors on standard error."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, Self, TextIO

from insnav.cli import signals
from insnav.exceptions import InsnavError, OutputError, reason_of

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from insnav.output.folder import RunFolder
    from insnav.report.page import Page, Show
    from insnav.result import Result

DELAY = 1.0  # work shorter than this shows no progress bar [s]
# where there is no terminal, after this, twice, four times this and so on a line says what is being done [s]
LOGGED = 15.0
WIDTH = 110  # largest of a line of the log
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

    `folder`: with its ``run.json``; `out`: as it was named.
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
    """Sum up a result: lines of 80 columns on a terminal; elsewhere nothing of a run is wrapped or cut."""
    from insnav.report.run.page import text
    from insnav.report.save import text_of

    return text(found, None) if found.kind == "run" and not sys.stdout.isatty() else text_of(found)


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
    width = min(WIDTH, shutil.get_terminal_size((WIDTH, 0)).columns)
    lines = wrapped(
        body, width, initial_indent=lead, subsequent_indent=" " * 10, break_long_words=False, break_on_hyphens=False
    )
    print("\n".join(lines), file=stream or sys.stderr, flush=True)


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


class Stages:
    """Names what is being done: with a bar on a terminal once the work has taken a second, else by a line now and then.

    Use it as a context manager, inside the one that removes what is half written. Call it with a name at the start of
    each stage, and with `fraction` where the stage knows how far it is.
    """

    def __init__(self) -> None:
        self._name = ""
        self._fraction: float | None = None
        self._total = 0
        self._bar: Progress | None = None
        self._task: TaskID | None = None
        self._timer: threading.Timer | None = None
        self._lock = threading.Lock()
        self._stream = sys.stderr  # that of now: a drive of a fleet is navigated without a word

    def __enter__(self) -> Self:
        if level >= 0:
            if sys.stderr.isatty():
                self._begin(DELAY, self._show)
            else:
                self._begin(LOGGED, self._say, LOGGED)
        return self

    def _begin(self, delay: float, what: Callable[..., None], *more: float) -> None:
        self._timer = threading.Timer(delay, what, more)
        self._timer.daemon = True
        self._timer.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        signals.arrived()
        if self._timer is not None:
            self._timer.cancel()
        with self._lock:
            self._timer = None
            if self._bar is not None:
                self._bar.stop()
                self._bar = None

    def __call__(self, name: str, fraction: float | None = None, total: int = 0) -> None:
        """Begin a stage, or say how far it is, of so many in all."""
        with self._lock:
            if name != self._name and self._bar is not None and self._task is not None:
                self._bar.reset(self._task, description=name, total=None)
            self._name, self._fraction, self._total = name, fraction, total
            self._update()

    def _update(self) -> None:
        if self._bar is not None and self._task is not None:
            total = None if self._fraction is None else 1.0
            count = f" {round((self._fraction or 0.0) * self._total)}/{self._total}" if self._total else ""
            self._bar.update(self._task, description=self._name + count, total=total, completed=self._fraction or 0.0)

    def _say(self, since: float) -> None:
        from insnav.messages import phrase

        with self._lock:
            if self._timer is not None:
                _log(phrase("terminal.so_far", stage=self._name, time_s=since), "insnav: ", self._stream)
                self._begin(since, self._say, 2.0 * since)

    def _show(self) -> None:
        from rich import progress
        from rich.console import Console

        to_come = (progress.TextColumn("to come"), progress.TimeRemainingColumn())
        done = (progress.BarColumn(), progress.TaskProgressColumn(), progress.TimeElapsedColumn())
        columns = (progress.TextColumn("{task.description:<10}"), *done, *to_come)
        with self._lock:
            if self._timer is None:  # the work ended meanwhile
                return
            self._bar = progress.Progress(*columns, console=Console(file=self._stream), transient=True)
            self._task = self._bar.add_task(self._name, total=None)
            self._update()
            self._bar.start()
