"""Arrays of long drives: large arrays are in temporary files, and memory contains only the parts in use.

Each file is unnamed and disappears with the last use of its array, however the program ends. Functions process blocks
of rows, sized for speed. Results are identical to one computation on all rows.
"""

from __future__ import annotations

import ctypes
import math
import mmap
import os
import sys
import tempfile
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insnav.exceptions import NO_ROOM, OutputError, reason_of

LARGE = 64 << 20  # bytes in memory of all arrays larger than `SMALL`; further arrays are in files
SMALL = 1 << 20  # bytes; smaller arrays are always in memory
ROWS = 1 << 16  # rows per block
_mapped: weakref.WeakSet[mmap.mmap] = weakref.WeakSet()  # mapped files in use
_read = 0.0  # rows read since memory was last released
_held: dict[int, int] = {}  # bytes of each array in memory larger than `SMALL`, by its id


def empty(shape: Sequence[int], dtype: Any = np.float64) -> NDArray[Any]:
    """Allocate an uninitialised array, in a file if the arrays in memory would exceed `LARGE`.

    Raises: OutputError: the disk is too full for the file.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size <= min(SMALL, LARGE):
        return np.empty(shape, dtype)
    if size + sum(_held.values()) <= LARGE:
        array = np.empty(shape, dtype)
        _held[id(array)] = size
        weakref.finalize(array, _held.pop, id(array)).atexit = False
        return array
    with tempfile.TemporaryFile(prefix="insnav-") as file:
        try:
            _reserve(file.fileno(), size)
        except OSError as error:
            raise _no_room(error, size) from error
        memory = mmap.mmap(file.fileno(), size)
    _give_back()
    return np.ndarray(shape, dtype, buffer=watched(memory))


@cache
def _give_back() -> None:
    """Make glibc return freed arrays to the system at once: it keeps sizes up to 32 MB, half of a day's arrays."""
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "mallopt"):
        libc.mallopt(-3, 4 << 20)  # M_MMAP_THRESHOLD: larger arrays have their own maps
        libc.mallopt(-1, 64 << 20)  # M_TRIM_THRESHOLD


def trim() -> None:
    """Return the memory of freed arrays to the system now: glibc keeps arrays below 32 MB."""
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "malloc_trim"):
        libc.malloc_trim(0)


def together(pieces: Iterable[bytes]) -> bytes | mmap.mmap:
    """Concatenate bytes; in a file if they exceed `LARGE`.

    Raises: OutputError: the disk is too full for the file.
    """
    size = 0
    try:
        with tempfile.SpooledTemporaryFile(LARGE, prefix="insnav-") as file:
            for piece in pieces:
                size += len(piece)
                file.write(piece)
            file.flush()
            if size > LARGE:
                return watched(mmap.mmap(file.fileno(), size, access=mmap.ACCESS_READ))
            file.seek(0)
            return file.read()
    except OSError as error:
        raise _no_room(error, size) from error


def _no_room(error: OSError, size: int) -> OSError | OutputError:
    """Build the error for a file of `size` bytes that does not fit on the disk; return other errors unchanged."""
    if error.errno not in NO_ROOM:
        return error
    return OutputError("engine.no_room", where=tempfile.gettempdir(), size=size >> 20, reason=reason_of(error))


def watched(memory: mmap.mmap) -> mmap.mmap:
    """Register a mapped file for `release`, and return it."""
    _mapped.add(memory)
    return memory


def release(rows: float = math.inf) -> None:
    """Release the memory of mapped files, but not their content; as this is slow, only after `ROWS` rows were read."""
    global _read
    _read += rows
    if _read >= ROWS and hasattr(mmap, "MADV_DONTNEED"):
        _read = 0.0
        for memory in list(_mapped):
            memory.madvise(mmap.MADV_DONTNEED)


def blocks(rows: int, *, before: int = 0, size: int = 0) -> Iterator[slice]:
    """Yield slices of `size` successive rows, each with `before` earlier rows; release memory after each slice."""
    size = size or ROWS
    for start in range(0, rows, size):
        yield slice(max(start - before, 0), min(start + size, rows))
        release(min(size, rows))


def by_blocks(function: Callable[..., NDArray[Any]], *arrays: NDArray[Any]) -> NDArray[Any]:
    """Apply a row-wise function to `arrays` in blocks of rows."""
    rows = len(arrays[0])
    if rows <= ROWS:
        return function(*arrays)
    out = None
    for part in blocks(rows):
        result = function(*(array[part] for array in arrays))
        if out is None:
            out = empty((rows, *result.shape[1:]), result.dtype)
        out[part] = result
    assert out is not None
    return out


def mean(values: NDArray[Any]) -> NDArray[Any]:
    """Compute the mean of all rows by blocks, for two columns or more, bit-identical to one sum over all rows."""
    total = np.zeros((0, *values.shape[1:]))
    for part in blocks(len(values)):  # `sum` would be five times slower for three columns
        total = np.einsum("ij->j", np.concatenate([total, values[part]]))[None]
    return np.asarray(total[0] / len(values))


def steps(values: NDArray[Any]) -> NDArray[Any]:
    """Compute differences of successive rows."""
    return by_blocks(np.subtract, values[1:], values[:-1])


def every(array: NDArray[Any], step: int) -> NDArray[Any]:
    """Select every `step`-th row."""
    size = step * max(1, LARGE // (step * max(array[:1].nbytes, 1)))
    # copies, since `blocks` releases the memory of each part
    return np.concatenate([array[part][::step].copy() for part in blocks(len(array), size=size)])


def chosen(array: NDArray[Any], selection: NDArray[Any]) -> NDArray[Any]:
    """Select rows of an array by a mask, or by row numbers."""
    numbers = np.flatnonzero(selection) if selection.dtype == np.bool_ else selection
    rows = by_blocks(lambda some: np.asarray(array[some]), numbers)
    release(len(numbers))
    return rows


def joined(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Concatenate arrays along their rows."""
    if len(parts) == 1:
        return parts[0]
    rows = sum(map(len, parts))
    if rows <= ROWS:
        return np.concatenate(parts)
    out, start = empty((rows, *parts[0].shape[1:]), parts[0].dtype), 0
    for part in parts:
        out[start : start + len(part)] = part
        start += len(part)
        release()
    return out


def _reserve(file: int, size: int) -> None:
    """Reserve the disk space now: on a full disk, a later write to the mapped file would end the process."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
        return
    zeros = bytes(1 << 20)
    for start in range(0, size, len(zeros)):
        os.write(file, zeros[: size - start])
