"""What the user sees: results on standard output, progress and errors on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rich.progress import Progress

DELAY = 1.0  # work shorter than this shows no progress bar [s]


def error_block(what: str, details: Iterable[tuple[str, str]]) -> None:
    """Print one error: what, and where, why, how to mend it."""
    print(f"insnav: error: {_plain(what)}", file=sys.stderr)
    for name, text in details:
        if text:
            print(f"  {name + ':':<6} {_plain(text)}", file=sys.stderr)


def note(text: str) -> None:
    """Print one line of the log."""
    print(f"insnav: {_plain(text)}", file=sys.stderr, flush=True)


def _plain(text: str) -> str:
    from insnav.io.text import plain_text

    return "\n         ".join(plain_text(line) for line in text.splitlines())


class Report(Protocol):
    """Takes the fraction done."""

    def __call__(self, fraction: float) -> None:
        """Note the fraction done."""


@contextmanager
def progress(title: str) -> Iterator[Report]:
    """Progress bar on a terminal, shown once the work has taken a second."""
    begin = time.monotonic()
    bar: list[Progress] = []

    def report(fraction: float) -> None:
        if not sys.stderr.isatty() or (not bar and time.monotonic() - begin < DELAY):
            return
        if not bar:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

            columns = (
                TextColumn("{task.description}"),
                BarColumn(),
                TaskProgressColumn(),
                TimeRemainingColumn(),
            )
            bar.append(Progress(*columns, console=Console(stderr=True), transient=True))
            bar[0].start()
            bar[0].add_task(title, total=1.0)
        bar[0].update(bar[0].task_ids[0], completed=fraction)

    try:
        yield report
    finally:
        for each in bar:
            each.stop()
