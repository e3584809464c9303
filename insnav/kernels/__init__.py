"""Compiled functions over plain arrays in SI units and radians, without input, output or logging."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from pickle import UnpicklingError
from types import SimpleNamespace
from typing import Any

from insnav.deferred import deferred

# numba reads this variable once. Coloured error messages take 3 % of the compile time: numba raises many errors.
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
with deferred("yaml"):  # numba only tests whether this module exists
    import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import ll  # type: ignore[attr-defined]
from numba.core.runtime import _nrt_python as _nrt  # type: ignore[attr-defined]
from numba.core.runtime.nrt import rtsys

CONTENT = hashlib.sha256(b"".join(each.read_bytes() for each in sorted(Path(__file__).parent.glob("*.py")))).hexdigest()
# Register the addresses of numba's C functions, which stored kernels call, with the linker. Otherwise numba compiles
# functions that every stored kernel contains (20 MB, 15 ms).
for _name, _address in _nrt.c_helpers.items():
    ll.add_symbol(_name if _name.startswith("_") else f"NRT_{_name}", _address)
_NAMED = "numba.cpython.numbers", "numba.np.arrayobj", "numba.np.npyimpl"


class _Rebuilt(CompileResultCacheImpl):
    """Loader of compiled kernels. It parses the bitcode of a kernel only when a calling kernel has to be compiled."""

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        (name, kind, (code, bitcode)), entry, *rest = payload
        target_context.codegen()._engine._defined_symbols |= {entry.llvm_func_name, entry.llvm_cpython_wrapper_name}
        payload = (name, kind, (code, ll.parse_assembly("").as_bitcode())), entry, *rest
        kernel = super().rebuild(target_context, payload)  # type: ignore[no-untyped-call]
        # numba clones a module before it links the module, so only linking parses the bitcode
        kernel.library._shared_module = SimpleNamespace(clone=partial(ll.parse_bitcode, bitcode))
        return kernel


class _Kept(FunctionCache):
    """Cache of compiled kernels on disk. It loads numba's model of numpy only to compile (0.12 s)."""

    _impl_class = _Rebuilt

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        # numba's stamp covers one source file only, but kernels from other files are compiled into this kernel
        self._cache_file._source_stamp = self._cache_file._source_stamp, CONTENT

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        # omit the hash of the bytecode: it depends on Python options such as -OO, and the stamp covers the source
        *rest, (_, closure) = super()._index_key(sig, codegen)  # type: ignore[no-untyped-call]
        return (*rest, closure)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a kernel without importing numba's model of numpy, which only compilation needs."""
        found = None
        try:
            # A pickled kernel names the modules of `_NAMED` as the origin of functions, but needs nothing from them.
            with self._guard_against_spurious_io_errors(), deferred(*_NAMED):
                found = self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except (EOFError, UnpicklingError):  # truncated file, for example after a full disk
            with suppress(OSError):
                self.flush()  # type: ignore[no-untyped-call]
        if found is None:
            rtsys.initialize(target_context)
            with deferred("scipy.linalg", "scipy.linalg.cython_blas"):  # numba only tests whether they exist
                import_module("numba.np.arraymath")
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):  # a full disk does not abort a run: the next run compiles again
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]


# Division by zero gives inf or NaN, as in numpy. No C code calls kernels: omitting the C wrapper saves a tenth of the
# compile time. Numba shares compiled numpy functions between kernels, so all kernels need the same flags.
_njit: Any = partial(numba.njit, error_model="numpy", no_cfunc_wrapper=True, fastmath={"contract"})


def njit(*, cache: bool = False, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a function as a compiled kernel."""

    def compiled(function: Callable[..., Any]) -> Any:
        kernel = _njit(function, **options)
        if cache:
            with suppress(RuntimeError):  # no writable directory for the cache: every run compiles
                kernel._cache = _Kept(function)
        return kernel

    return compiled


inner = partial(njit, no_cpython_wrapper=True)  # decorator of functions that only kernels call, not Python
