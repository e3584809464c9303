"""Stop requests: Ctrl-C, SIGTERM and a CPU limit unwind the program, so that incomplete folders are removed.

A handler stops the program by raising. An exception raised inside a destructor or a callback of compiled code is lost,
so the signal is repeated until `arrived` is called.
"""

from __future__ import annotations

import signal
import sys
import threading
from types import FrameType

# Windows has no limit of the CPU time
STOPS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGXCPU") if hasattr(signal, name))
PATIENCE = 0.2  # before a request is repeated [s]

_repeat: threading.Timer | None = None
_requested = _heard = False


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
    """Ignore further requests: the work is done, and stopping would resemble a failure."""
    for number in STOPS:
        signal.signal(number, signal.SIG_IGN)


def arrived() -> None:
    """Stop repeating the request, including a repetition in progress: unwinding must not be disturbed."""
    global _heard
    _heard = _requested
    _cancel()


def _cancel() -> None:
    global _repeat
    if _repeat is not None:
        _repeat.cancel()
        _repeat = None


def _stop(number: int, frame: FrameType | None) -> None:
    global _repeat, _requested
    if _heard:
        return
    _requested = True
    _cancel()
    _repeat = threading.Timer(PATIENCE, signal.raise_signal, (number,))
    _repeat.daemon = True
    _repeat.start()
    raise Stopped(number)


def _unless_stopped(lost: sys.UnraisableHookArgs) -> None:
    """Suppress reports of lost exceptions while stopping: the request, or destructors of incomplete objects."""
    if not _requested:
        sys.__unraisablehook__(lost)
