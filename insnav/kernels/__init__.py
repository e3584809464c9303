"""All compiled code: functions over plain arrays in SI and radians; no input or output, no logging."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

from insnav.deferred import deferred

# numba reads it once: colours for errors, of which it makes many that it gets over, take 3 % of the compiling
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
with deferred("yaml"):  # it only looks whether it is there
    import numba
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys

CONTENT = hashlib.sha256(b"".join(each.read_bytes() for each in sorted(Path(__file__).parent.glob("*.py")))).hexdigest()
_NAMED = "numba.cpython.numbers", "numba.np.arrayobj", "numba.np.npyimpl"


class _Kept(FunctionCache):
    """Compiled kernels on the disk; what numba knows of numpy is loaded where it has to compile only (0.12 s)."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        # numba looks at the file of a kernel alone: kernels of other files are compiled into it
        self._cache_file._source_stamp = self._cache_file._source_stamp, CONTENT

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        # bytecode depends on the options of Python, as -OO, and the source is in the stamp; a closure is not
        *rest, (_, closure) = super()._index_key(sig, codegen)  # type: ignore[no-untyped-call]
        return (*rest, closure)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = None
        rtsys.initialize(target_context)
        try:
            # a kernel names them as where functions within it come from, and needs nothing of them
            with self._guard_against_spurious_io_errors(), deferred(*_NAMED):
                found = self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except (EOFError, UnpicklingError):  # cut short, as by a disk that was full
            with suppress(OSError):
                self.flush()  # type: ignore[no-untyped-call]
        if found is None:
            with deferred("scipy.linalg", "scipy.linalg.cython_blas"):  # as above
                import_module("numba.np.arraymath")
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):  # a full disk keeps no run from its end: the next one compiles again
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]


# division by zero gives inf or NaN, as in numpy, and C calls no kernel: a tenth less to compile. What numba compiles of
# numpy for one kernel is taken for others: with other liberties in one of them, results depend on which came first.
_njit: Any = partial(numba.njit, error_model="numpy", no_cfunc_wrapper=True, fastmath={"contract"})


def njit(*, cache: bool = False, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator of a kernel."""

    def compiled(function: Callable[..., Any]) -> Any:
        kernel = _njit(function, **options)
        if cache:
            with suppress(RuntimeError):  # nowhere to write: every run compiles
                kernel._cache = _Kept(function)
        return kernel

    return compiled


inner = partial(njit, no_cpython_wrapper=True)  # called by kernels alone: kept within these, no entry from Python
