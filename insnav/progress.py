"""Progress of the work: stage, fraction and remaining time, announced by the work, displayed by its caller."""

from __future__ import annotations

import functools
import itertools
import math
import sys
import threading
import time
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any, ParamSpec, Self, TypeVar

from insnav.messages import phrase, word

P = ParamSpec("P")
T = TypeVar("T")
DELAY, REDRAWN = 1.0, 0.2  # before the first display, and between displays [s]
_shown: list[Stages] = []  # the last one displays announcements


def announce(name: str) -> None:
    """Announce the next stage of the work to the display, if any."""
    for stage in _shown[-1:]:
        stage(name)


class Stages:
    """Stages of the work, as a line passed to `show` after each of `waits` [s], and empty at the end.

    Use it as a context manager. Call it with a name at the start of each stage, and with `fraction` if the stage knows
    its progress.
    """

    def __init__(self, show: Callable[[str], object], waits: Iterable[float]) -> None:
        self._show, self._waits = show, iter(waits)
        self._begin, self._name, self._total = time.monotonic(), "computing", 0
        self._reports: list[tuple[float, float]] = []  # of this stage: time of the report [s], fraction done
        self._working, self._lock = True, threading.Lock()

    def __enter__(self) -> Self:
        _shown.append(self)
        self._wait()
        return self

    def __exit__(self, *error: object) -> None:
        _shown.remove(self)
        with self._lock:
            self._working = False
            self._show("")

    def _wait(self) -> None:
        for wait in itertools.islice(self._waits, 1):
            timer = threading.Timer(wait, self._tick)
            timer.daemon = True
            timer.start()

    def _tick(self) -> None:
        with self._lock:
            if self._working:
                self._show(self.line())
                self._wait()

    def __call__(self, name: str, fraction: float | None = None, total: int = 0) -> None:
        """Begin a stage, or report its fraction, optionally with the total count."""
        with self._lock:
            if name != self._name or (fraction is not None and self._reports and fraction < self._reports[-1][1]):
                self._reports = []
            self._name, self._total = name, total
            self._reports += [] if fraction is None else [(time.monotonic(), fraction)]

    def advance(self, fraction: float) -> None:
        """Report the fraction of the stage."""
        self(self._name, fraction, self._total)

    def line(self) -> str:
        """Compose stage and elapsed time, with fraction and remaining time if known."""
        now, share = time.monotonic(), self._reports[-1][1] if self._reports else math.nan
        count = f" {round(share * self._total)}/{self._total}" if self._total and self._reports else ""
        how = {"share": share, "time_s": now - self._begin, "left_s": self._left(now)}
        return phrase("terminal.so_far", stage=word(self._name) + count, **how)

    def _left(self, now: float) -> float:
        """Estimate the remaining time from the speed in the later half of the stage [s]; NaN before two reports.

        The mean speed would be too optimistic after a fast beginning.
        """
        if not self._reports:
            return math.nan
        half = 0.5 * (self._reports[0][0] + now)
        (begin, share), (last, done) = max(each for each in self._reports if each[0] <= half), self._reports[-1]
        left = (1.0 - done) * (last - begin) / (done - share) - (now - last) if done > share else math.nan
        return left if left > 0.0 else math.nan


def in_notebook(method: Callable[P, T]) -> Callable[P, T]:
    """Display the progress of a method with a `progress` argument, if a notebook calls it without."""

    @functools.wraps(method)
    def shown(*args: P.args, **kwargs: P.kwargs) -> T:
        shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
        if _shown or kwargs.get("progress") is not None or getattr(shell, "kernel", None) is None:
            return method(*args, **kwargs)
        handle: Any = import_module("IPython.display").display({"text/plain": ""}, raw=True, display_id=True)
        waits = itertools.chain((DELAY,), itertools.repeat(REDRAWN))
        with Stages(lambda line: handle.update({"text/plain": line}, raw=True), waits) as stage:
            kwargs["progress"] = stage.advance
            return method(*args, **kwargs)

    return shown
