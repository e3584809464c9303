"""Arrays of long drives: beyond some size they lie in a temporary file, and memory holds what is in use of them.

The file has no name, so that it goes with the last use of the array however the program ends. Blocks of rows are as
many as give the same numbers faster than the whole.
"""

from __future__ import annotations

import ctypes
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

LARGE = 64 << 20  # bytes of an array that never stays in memory
SMALL = 1 << 20  # bytes of one that always does
MOST = 192 << 20  # bytes of those between that do together: page faults of a file cost more
ROWS = 1 << 16  # of a block
_mapped: weakref.WeakSet[mmap.mmap] = weakref.WeakSet()
_held: dict[int, int] = {}  # bytes of arrays in memory that are not small


def empty(shape: Sequence[int], dtype: Any = np.float64) -> NDArray[Any]:
    """Array to be filled; in a file if it is larger than `LARGE`, or others already fill the memory.

    Raises: OutputError: there is no room for the file.
    """
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    if size <= min(SMALL, LARGE):
        return np.empty(shape, dtype)
    if size <= LARGE and size + sum(_held.values()) <= MOST:
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
    """Let go of freed arrays at once from now on: glibc keeps those of up to 32 MB, half of what a day fills."""
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "mallopt"):
        libc.mallopt(-3, 4 << 20)  # M_MMAP_THRESHOLD: larger ones lie in maps of their own
        libc.mallopt(-1, 64 << 20)  # M_TRIM_THRESHOLD


def together(pieces: Iterable[bytes]) -> bytes | mmap.mmap:
    """Bytes one after the other; in a file if they are more than `LARGE`.

    Raises: OutputError: there is no room for the file.
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
    """What to raise where a file of so many bytes could not be written."""
    if error.errno not in NO_ROOM:
        return error
    return OutputError("engine.no_room", where=tempfile.gettempdir(), size=size >> 20, reason=reason_of(error))


def watched(memory: mmap.mmap) -> mmap.mmap:
    """Let `release` know of a mapped file."""
    _mapped.add(memory)
    return memory


def release() -> None:
    """Let go of the memory that mapped files fill; what they hold stays."""
    if hasattr(mmap, "MADV_DONTNEED"):
        for memory in list(_mapped):
            memory.madvise(mmap.MADV_DONTNEED)


def blocks(rows: int, *, before: int = 0, size: int = 0) -> Iterator[slice]:
    """Parts of so many rows in order, of a `size` and with some rows `before` each; memory is let go after each."""
    size = size or ROWS
    for start in range(0, rows, size):
        yield slice(max(start - before, 0), min(start + size, rows))
        release()


def by_blocks(function: Callable[..., NDArray[Any]], *arrays: NDArray[Any]) -> NDArray[Any]:
    """Array of a function that makes each row of it from that row of `arrays`."""
    rows = len(arrays[0])
    if rows <= ROWS:
        return function(*arrays)
    out = None
    for part in blocks(rows):
        found = function(*(array[part] for array in arrays))
        if out is None:
            out = empty((rows, *found.shape[1:]), found.dtype)
        out[part] = found
    assert out is not None
    return out


def mean(values: NDArray[Any]) -> NDArray[Any]:
    """Mean of rows, of two columns or more: the sum goes on from block to block, with the bits of that of all."""
    total = np.zeros((0, *values.shape[1:]))
    for part in blocks(len(values)):  # `sum` takes five times as long for rows of three
        total = np.einsum("ij->j", np.concatenate([total, values[part]]))[None]
    return np.asarray(total[0] / len(values))


def steps(values: NDArray[Any]) -> NDArray[Any]:
    """Differences of successive values."""
    return by_blocks(np.subtract, values[1:], values[:-1])


def every(array: NDArray[Any], step: int) -> NDArray[Any]:
    """Each so-manieth row."""
    size = step * max(1, LARGE // (step * max(array[:1].nbytes, 1)))
    return np.concatenate([array[part][::step].copy() for part in blocks(len(array), size=size)])  # before letting go


def chosen(array: NDArray[Any], selection: NDArray[Any]) -> NDArray[Any]:
    """Rows of an array by a mask, or by their numbers."""
    if array.nbytes <= LARGE:
        return np.asarray(array[selection])
    numbers = np.flatnonzero(selection) if selection.dtype == np.bool_ else selection
    return by_blocks(lambda some: array[some], numbers)


def joined(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Arrays one after the other."""
    if len(parts) == 1:
        return parts[0]
    out, at = empty((sum(map(len, parts)), *parts[0].shape[1:]), parts[0].dtype), 0
    for part in parts:
        out[at : at + len(part)] = part
        at += len(part)
        release()
    return out


def _reserve(file: int, size: int) -> None:
    """Take the room on the disk at once: a page that finds none later would end the process."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
        return
    zeros = bytes(1 << 20)
    for at in range(0, size, len(zeros)):
        os.write(file, zeros[: size - at])
