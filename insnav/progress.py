"""Progress of a computation: stage, fraction and remaining time. The computation reports, its caller displays."""

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
_shown: list[Stages] = []  # active displays; the last one receives announcements


def announce(name: str) -> None:
    """Announce the next stage of the computation to the active display, if any."""
    for stage in _shown[-1:]:
        stage(name)


class Stages:
    """Display of the stages of a computation.

    A timer passes the current line to `show` after each of the delays `waits` [s]; at the end `show` gets an empty
    line. Use it as a context manager. Call it with a name at the start of a stage, and with `fraction` for progress.
    """

    def __init__(self, show: Callable[[str], object], waits: Iterable[float]) -> None:
        self._show, self._waits = show, iter(waits)
        self._begin, self._name, self._total = time.monotonic(), "computing", 0
        self._reports: list[tuple[float, float]] = []  # reports of this stage: time [s], fraction done
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
        for wait in itertools.islice(self._waits, 1):  # the next delay, if any
            timer = threading.Timer(wait, self._tick)
            timer.daemon = True
            timer.start()

    def _tick(self) -> None:
        with self._lock:
            if self._working:
                self._show(self.line())
                self._wait()

    def __call__(self, name: str, fraction: float | None = None, total: int = 0) -> None:
        """Begin the stage `name`, or report the fraction done of it; `total`: number of items in the stage, if any."""
        with self._lock:
            if name != self._name or (fraction is not None and self._reports and fraction < self._reports[-1][1]):
                self._reports = []
            self._name, self._total = name, total
            self._reports += [] if fraction is None else [(time.monotonic(), fraction)]

    def advance(self, fraction: float) -> None:
        """Report the fraction done of the current stage."""
        self(self._name, fraction, self._total)

    def line(self) -> str:
        """Write stage and elapsed time, with fraction done and remaining time if known."""
        now, share = time.monotonic(), self._reports[-1][1] if self._reports else math.nan
        count = f" {round(share * self._total)}/{self._total}" if self._total and self._reports else ""
        values = {"share": share, "time_s": now - self._begin, "left_s": self._left(now)}
        return phrase("terminal.so_far", stage=word(self._name) + count, **values)

    def _left(self, now: float) -> float:
        """Estimate the remaining time [s] from the speed in the later half of the stage; NaN before two reports.

        The mean speed would be too optimistic after a fast beginning.
        """
        if not self._reports:
            return math.nan
        middle = 0.5 * (self._reports[0][0] + now)  # time halfway through the stage so far
        (begin, share), (last, done) = max(report for report in self._reports if report[0] <= middle), self._reports[-1]
        remaining = (1.0 - done) * (last - begin) / (done - share) - (now - last) if done > share else math.nan
        return remaining if remaining > 0.0 else math.nan


def in_notebook(method: Callable[P, T]) -> Callable[P, T]:
    """Decorate a method: if a notebook calls it without its `progress` argument, its progress is displayed."""

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
