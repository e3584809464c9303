"""Deferred imports: libraries loaded on first use, and rarely used imports of a library."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any


class _Later(ModuleType):
    """Placeholder of a module while others are imported."""

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda *given, **named: getattr(import_module(self.__name__), name)(*given, **named)


class _Library(ModuleType):
    """Placeholder of a library until first use."""

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self.__name__), name)


def library(name: str) -> Any:
    """Import a library, or a module of one, on first use."""
    return _Library(name)


@contextmanager
def deferred(*names: str) -> Iterator[None]:
    """Skip these modules while another module imports them."""
    later = {name: _Later(name) for name in names if name not in sys.modules}
    sys.modules.update(later)
    try:
        yield
    finally:
        for name in later:
            del sys.modules[name]
