"""Deferred imports: libraries loaded on first use, and modules that a library imports but rarely uses."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any


class _Later(ModuleType):
    """Placeholder of a module: calling one of its functions imports the module."""

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda *given, **named: getattr(import_module(self.__name__), name)(*given, **named)


class _Library(ModuleType):
    """Placeholder of a library: reading one of its attributes imports the library."""

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self.__name__), name)


def library(name: str) -> Any:
    """Return a placeholder that imports a library, or a module of a library, on first use."""
    return _Library(name)


@contextmanager
def deferred(*names: str) -> Iterator[None]:
    """Replace the modules `names` by placeholders, so that imports inside the ``with`` block do not load them."""
    placeholders = {name: _Later(name) for name in names if name not in sys.modules}
    sys.modules.update(placeholders)
    try:
        yield
    finally:
        for name in placeholders:
            del sys.modules[name]
