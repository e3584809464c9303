"""What is being done, how far it is and how long it takes: named by who works, shown by the command or the notebook."""

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
DELAY, REDRAWN = 1.0, 0.2  # before a line is shown first, and from then on [s]
_shown: list[Stages] = []  # the last one shows what is announced


def announce(name: str) -> None:
    """Name the stage of the work that begins, for whoever shows it; nobody need."""
    for stage in _shown[-1:]:
        stage(name)


class Stages:
    """Names what is being done, in a line that is handed to `show` after each of `waits` [s], and empty in the end.

    Use it as a context manager. Call it with a name at the start of each stage, and with `fraction` where the stage
    knows how far it is.
    """

    def __init__(self, show: Callable[[str], object], waits: Iterable[float]) -> None:
        self._show, self._waits = show, iter(waits)
        self._begin, self._name, self._total = time.monotonic(), "", 0
        self._reports: list[tuple[float, float]] = []  # of this stage: time [s] and fraction
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
        """Begin a stage, or say how far it is, of so many in all."""
        with self._lock:
            if name != self._name or (fraction is not None and self._reports and fraction < self._reports[-1][1]):
                self._reports = []
            self._name, self._total = name, total
            self._reports += [] if fraction is None else [(time.monotonic(), fraction)]

    def advance(self, fraction: float) -> None:
        """Say how far the stage is."""
        self(self._name, fraction, self._total)

    def line(self) -> str:
        """Say what is being done and since when; how far it is and how long it still takes, where that is known."""
        now, share = time.monotonic(), self._reports[-1][1] if self._reports else math.nan
        count = f" {round(share * self._total)}/{self._total}" if self._total and self._reports else ""
        how = {"share": share, "time_s": now - self._begin, "left_s": self._left(now)}
        return phrase("terminal.so_far", stage=word(self._name) + count, **how)

    def _left(self, now: float) -> float:
        """Time that the rest takes at the speed of the latter half of the stage [s]; NaN without two reports of it.

        The speed of the whole would promise too little where the quick part comes first.
        """
        if not self._reports:
            return math.nan
        half = 0.5 * (self._reports[0][0] + now)
        (begin, share), (last, done) = max(each for each in self._reports if each[0] <= half), self._reports[-1]
        left = (1.0 - done) * (last - begin) / (done - share) - (now - last) if done > share else math.nan
        return left if left > 0.0 else math.nan


def in_notebook(method: Callable[P, T]) -> Callable[P, T]:
    """Show the progress of a method that takes `progress`, where a notebook calls it without."""

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
