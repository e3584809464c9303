"""Console output: results on standard output, progress and errors on standard error; stop requests.

Ctrl-C, SIGTERM and a CPU limit unwind the program, so that incomplete folders are removed. The signal handler raises
`Stopped`, unless compiled code waits for the interrupted function. As an exception raised inside a destructor is lost,
a timer repeats the signal until `arrived` is called.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import shutil
import signal
import sys
import threading
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Literal, TextIO

from insnav import progress
from insnav.exceptions import InsnavError, OutputError, reason_of

if TYPE_CHECKING:
    from insnav.output.folder import RunFolder
    from insnav.report.page import Page
    from insnav.result import Result

# without a terminal, log lines report the current work after this time [s], twice this time, four times, …
LOGGED = 15.0
WIDTH = 110  # columns of a log line without a terminal
CLEARED = "\r\x1b[K"  # clears the progress line of a terminal
_COLOURS = {"light.good": 32, "light.attention": 33, "light.bad": 31, "run.warning": 33}  # terminal colour of a phrase


level = 0  # amount of output: -1 errors only, 0 normal, 1 everything


def result(text: str, *, always: bool = False) -> None:
    """Print the requested result on standard output.

    `always`: print also in quiet mode, as the user requested this output.
    Raises: OutputError: standard output fails, such as a file on a full disk. BrokenPipeError: its reader closed it.
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
    """Print the ``run.json`` of a finished folder, on standard output."""
    from insnav.output.folder import FACTS_FILE

    result((folder / FACTS_FILE).read_text(encoding="utf-8").rstrip("\n"), always=True)


def files_line(folder: Path, out: Path) -> str:
    """List the content of a finished folder in one line, each subfolder once, the most readable files first.

    `folder`: contains ``run.json``. `out`: name of the folder as the user specified it.
    """
    from insnav.messages import form, phrase
    from insnav.output.folder import read_facts

    present = {name.split("/")[0] for name in read_facts(folder).get("files", {})} | {"run.json"}
    first = [name for name in ("report.html", "figures", "run.json") if name in present]
    others = len(present) - len(first)
    return phrase("terminal.files", folder=out, names=form("list").join(first), others=others)


def result_page(folder: Path, page: Page, out: Path, *, as_json: bool, more: Iterable[str] = ()) -> None:
    """Print the report of a finished folder and its location, or its ``run.json`` instead."""
    if as_json:
        result_facts(folder)
        return
    from insnav.report.terminal import entry

    names = ", ".join(name for name in (*more, "report.html", "figures", "run.json") if (folder / name).exists())
    result(shown_page(page, f"{entry('files', '')}{out}: {names}"))


def shown_page(page: Page, files: str = "") -> str:
    """Write a report for the terminal: a few lines, or the whole report in verbose mode."""
    from insnav.messages import phrase
    from insnav.report.terminal import brief_text, hanging, page_text

    width = terminal_width()
    if level > 0:
        return coloured("\n\n".join([page_text(page, width, ("all", "page")), files]).rstrip())
    last = "; ".join(filter(None, (files, phrase("terminal.details"))))
    return coloured(brief_text(page, width, hanging([last], width)))


def write_result(outcome: Result[Any], folder: RunFolder, stage: Stages, **how: Any) -> Path:
    """Write a result by `insnav.report.save.save_result`, with the arguments `how`; return the finished folder."""
    stage("writing")
    from insnav.report.save import save_result

    quiet_figures()
    return save_result(outcome, folder, **how)


def summary_text(outcome: Result[Any]) -> str:
    """Summarise a result in lines of the terminal width; without a terminal, lines are not wrapped."""
    from insnav.report.save import text_of

    return text_of(outcome, terminal_width())


def terminal_width() -> int | None:
    """Return the number of terminal columns; None if standard output is no terminal."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def coloured(text: str) -> str:
    """Colour the ratings at the starts of lines, if the terminal has colours."""
    if not sys.stdout.isatty() or os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return text
    from insnav.messages import phrase

    for name, colour in _COLOURS.items():
        words = phrase(name)
        text = re.sub(rf"^{words}(?=[: (：（])", f"\x1b[{colour}m{words}\x1b[0m", text, flags=re.MULTILINE)
    return text


def quiet_figures() -> None:
    """Suppress log messages of matplotlib, such as on its cache."""
    import logging

    logging.getLogger("matplotlib").setLevel(logging.ERROR)


def discard_output() -> None:
    """Discard remaining output, including the interpreter's final flush."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def error_block(error: InsnavError) -> None:
    """Print one error: statement, location, evidence, advice and code."""
    from insnav.messages import form

    lines = [f"insnav: {form('error')} {_plain(error.what)}"]
    lines += [f"  {label} {_plain(text)}" for label, text in error.details() if text]
    if sys.stderr.isatty():
        from insnav.plain_text import wrapped

        width, rows = shutil.get_terminal_size().columns, "\n".join(lines).splitlines()
        lines = [part for row in rows for part in wrapped(row, width, subsequent_indent=" " * 9)]
    print("\n".join(lines), file=sys.stderr, flush=True)


def note(text: str) -> None:
    """Print one log entry on standard error, in the language of the messages."""
    from insnav.messages import translated

    if level >= 0:
        _log(translated(text), "insnav: ")


def note_warnings(outcome: Result[Any]) -> None:
    """Print the warnings of a result in the log."""
    from insnav.findings import Severity
    from insnav.messages import sentence

    for finding in outcome.findings:
        if finding.severity >= Severity.WARNING:
            note(sentence(finding))


def detail(text: str, *more: str) -> None:
    """Print one log entry and its details, only in verbose mode."""
    if level > 0:
        note(text)
        for line in more:
            _log(line, "        ")


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
    """Provide the output folder of a command, complete or absent at the end, and the display of its stages."""
    from insnav.output.folder import RunFolder

    with RunFolder(out, force=force) as folder, Stages() as stage:
        yield folder, stage
    if folder.kept is not None:
        from insnav.messages import phrase

        note(phrase("terminal.kept", folder=folder.kept.name))


class Stages(progress.Stages):
    """Display of stages on a redrawn terminal line; without a terminal, by occasional log lines.

    Use it inside the context manager that removes incomplete output.
    """

    def __init__(self) -> None:
        stream = sys.stderr  # the stream at this time: `insnav batch` replaces it for each drive
        if stream.isatty():
            waits: Iterable[float] = itertools.chain((progress.DELAY,), itertools.repeat(progress.REDRAWN))
        else:
            waits = (LOGGED * 2.0 ** max(count - 1, 0) for count in itertools.count())
        super().__init__(partial(_show, stream), waits if level >= 0 else ())

    def __exit__(self, *error: object) -> None:
        arrived()
        super().__exit__(*error)


def _show(stream: TextIO, line: str) -> None:
    """Write the progress line over the previous line of the terminal, or as an entry of the log."""
    if stream.isatty():
        print(CLEARED + line[: shutil.get_terminal_size().columns - 1], end="", file=stream, flush=True)
    elif line:
        _log(line, "insnav: ", stream)


# signals that stop the program; Windows has no SIGXCPU, which signals a limit of the CPU time
STOPS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGXCPU") if hasattr(signal, name))
PATIENCE = 0.2  # time before the signal of a stop request is repeated [s]
# compiled code calls functions of these modules without checking for exceptions: raising there crashes the process
UNCHECKED = "llvmlite.binding", "numba.core.serialize"

_repeat = threading.Timer(PATIENCE, signal.raise_signal)  # repeats the signal; not started yet
_requested = _heard = False  # a stop was requested; its exception has arrived


class Stopped(BaseException):
    """Stop request of the user or the system."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


def listen() -> None:
    """Raise `Stopped` on Ctrl-C, SIGTERM and a limit of the CPU time."""
    sys.unraisablehook = _unless_stopped
    for number in STOPS:
        signal.signal(number, _stop)


def over() -> None:
    """Ignore further stop requests: the work is done, and stopping now would look like a failure."""
    for number in STOPS:
        signal.signal(number, signal.SIG_IGN)


def arrived() -> None:
    """Stop repeating the signal, since its exception has arrived: another exception would disturb unwinding."""
    global _heard
    _heard = _requested
    _repeat.cancel()


def _stop(number: int, frame: FrameType | None) -> None:
    global _repeat, _requested
    if _heard:
        return
    _requested = True
    _repeat.cancel()
    _repeat = threading.Timer(PATIENCE, signal.raise_signal, (number,))
    _repeat.daemon = True
    _repeat.start()
    # compiled code among the callers may not check for exceptions: then wait for the repeated signal
    while frame is not None and not frame.f_globals["__name__"].startswith(UNCHECKED):
        frame = frame.f_back
    if frame is None:
        raise Stopped(number)


def _unless_stopped(lost: sys.UnraisableHookArgs) -> None:
    """Suppress reports of exceptions lost in destructors while stopping: stop request, errors of incomplete objects."""
    if not _requested:
        sys.__unraisablehook__(lost)
