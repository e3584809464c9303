"""Messages in a stream of bytes, found by their first bytes: whatever lies between them is passed over."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insnav.types import FloatArray

if TYPE_CHECKING:
    import mmap

Bytes = NDArray[np.uint8]
_BLOCK = 1 << 25  # of messages looked at together [bytes]


def starts(data: bytes | mmap.mmap, first: bytes) -> NDArray[np.int64]:
    """Where given bytes stand in a stream, ``(n,)``."""
    return np.array([found.start() for found in re.finditer(re.escape(first), data)], dtype=np.int64)


def gathered(data: bytes | mmap.mmap, at: NDArray[np.int64], size: int) -> Bytes:
    """Messages of one size, a row each, ``(n, size)``; those that go beyond the end are left out."""
    stream = np.frombuffer(data, dtype=np.uint8)
    at = at[at <= len(stream) - size]
    return stream[at[:, None] + np.arange(size)] if len(at) else np.empty((0, size), dtype=np.uint8)


def sound_messages(
    data: bytes | mmap.mmap, at: NDArray[np.int64], size: int, sound: Callable[[Bytes], NDArray[np.bool_]]
) -> Iterator[tuple[NDArray[np.int64], Bytes]]:
    """Places and bytes of messages whose checksum is right, in blocks, so that memory is bounded."""
    step = max(1, _BLOCK // max(size, 1))
    for first in range(0, len(at), step):
        block = at[first : first + step]
        rows = gathered(data, block, size)
        good = sound(rows)
        yield block[: len(rows)][good], rows[good]


def as_records(rows: Bytes, layout: np.dtype[Any]) -> NDArray[Any]:
    """Rows of bytes as records ``(n,)`` of a layout, which may be shorter than a row."""
    return np.ascontiguousarray(rows[:, : layout.itemsize]).view(layout)[:, 0]


def joined(key: FloatArray, other: FloatArray, values: FloatArray) -> FloatArray:
    """Values of messages with the key of another one, ``NaN`` where there is none; of several, the last.

    `key` (n,): that of the rows wanted; `other` (m,), `values` (m, ...).
    """
    found = np.full((len(key), *values.shape[1:]), np.nan)
    if len(other):
        order = np.argsort(other, kind="stable")
        place = np.searchsorted(other[order], key, side="right") - 1
        there = (place >= 0) & (other[order][place] == key)
        found[there] = values[order[place[there]]]
    return found


def at_times(wanted: FloatArray, time: FloatArray, values: FloatArray) -> FloatArray:
    """Values of a sensor ``(m,)`` between whose samples those of another are, at its times ``(n,)``.

    Interpolated; ``NaN`` outside the record, and in gaps of more than five intervals.
    """
    order = np.argsort(time, kind="stable")
    time, values = time[order], values[order]
    if len(time) < 2:
        return np.full(len(wanted), np.nan)
    steps = np.diff(time)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    place = np.clip(np.searchsorted(time, wanted, side="right"), 1, len(time) - 1)
    found = np.interp(wanted, time, values, left=np.nan, right=np.nan)
    return np.where(steps[place - 1] <= 5.5 * usual, found, np.nan)
