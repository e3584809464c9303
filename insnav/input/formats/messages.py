"""Reader of binary messages in a stream of bytes: sync bytes locate them, other bytes are skipped."""

from __future__ import annotations

import mmap
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insnav.types import FloatArray

Bytes = NDArray[np.uint8]
_BLOCK = 1 << 25  # size of messages that are processed together [bytes]


def starts(data: bytes | mmap.mmap, first: bytes) -> NDArray[np.int64]:
    """Find the positions ``(n,)`` at which given bytes start in a stream."""
    return np.array([found.start() for found in re.finditer(re.escape(first), data)], dtype=np.int64)


def gathered(data: bytes | mmap.mmap, at: NDArray[np.int64], size: int) -> Bytes:
    """Gather messages of one size as rows, ``(n, size)``, except those beyond the end."""
    stream = np.frombuffer(data, dtype=np.uint8)
    at = at[at <= len(stream) - size]
    return stream[at[:, None] + np.arange(size)] if len(at) else np.empty((0, size), dtype=np.uint8)


def layout(text: str, kind: str = "") -> np.dtype[Any]:
    """Build a little-endian record layout from ``name:type`` fields; `kind` is the default type."""
    fields = (field.partition(":") for field in text.split())
    return np.dtype([(name, f"<{own or kind}") for name, _, own in fields])


def as_records(rows: Bytes, layout: np.dtype[Any]) -> NDArray[Any]:
    """View rows of bytes as records ``(n,)`` of a layout, which may be shorter than a row."""
    return np.ascontiguousarray(rows[:, : layout.itemsize]).view(layout)[:, 0]


@dataclass(slots=True)
class Messages:
    """Valid messages of one kind."""

    rows: list[Bytes] = field(default_factory=list)  # arrays (n, size), one or more for each size of messages
    at: list[NDArray[np.int64]] = field(default_factory=list)  # (n,) positions of these messages in the stream
    damaged: int = 0  # number of damaged messages

    def records(self, layout: np.dtype[Any], skip: int = 0) -> tuple[NDArray[Any], NDArray[np.int64]]:
        """Return records ``(n,)`` without a header of `skip` bytes, and their positions, in stream order."""
        long = [i for i, rows in enumerate(self.rows) if rows.shape[1] >= layout.itemsize + skip]
        found = [np.empty(0, dtype=layout), *(as_records(self.rows[i][:, skip:], layout) for i in long)]
        at = np.concatenate([np.empty(0, dtype=np.int64), *(self.at[i] for i in long)])
        order = np.argsort(at, kind="stable")
        return np.concatenate(found)[order], at[order]


@dataclass(frozen=True, slots=True)
class Framing:
    """Message framing of a protocol: sync bytes, message number and size in the header, checksum."""

    sync: bytes
    # message number and size field of two bytes: position in the message, and bit mask
    number: tuple[int, int]
    size: tuple[int, int]
    around: int  # bytes of a message that its size field does not count
    least: int  # size of the smallest message [bytes]
    sound: Callable[[Bytes], NDArray[np.bool_]]  # tests the checksums of whole messages (n, size)

    def recognise(self, head: bytes) -> bool:
        """Return whether a valid message starts in the first bytes of a file."""
        at = starts(head, self.sync)[:64]
        sizes = self._word(np.frombuffer(head + bytes(8), dtype=np.uint8), at, self.size) + self.around
        good = (sizes >= self.least) & (at + sizes <= len(head))
        messages = (gathered(head, at[i : i + 1], int(sizes[i])) for i in np.flatnonzero(good))
        return any(bool(self.sound(message)[0]) for message in messages)

    def find(self, data: bytes | mmap.mmap, numbers: Collection[int]) -> dict[int, Messages]:
        """Find the valid messages of the given numbers, and count damaged ones, by message number."""
        stream = np.frombuffer(data, dtype=np.uint8)
        at = starts(data, self.sync)
        at = at[at <= len(stream) - self.least]
        kinds, sizes = self._word(stream, at, self.number), self._word(stream, at, self.size) + self.around
        by_number = {number: Messages() for number in numbers}
        for number, messages in by_number.items():
            of_number = kinds == number
            for size in np.unique(sizes[of_number]).tolist():
                candidates = at[of_number & (sizes == size)]
                messages.damaged += len(candidates)
                step = max(1, _BLOCK // max(size, 1))  # process messages in blocks, to limit memory
                for first in range(0, len(candidates) if size >= self.least else 0, step):
                    block = candidates[first : first + step]
                    rows = gathered(data, block, size)
                    good = self.sound(rows)
                    messages.rows.append(rows[good])
                    messages.at.append(block[: len(rows)][good])
                    messages.damaged -= int(np.count_nonzero(good))
        return by_number

    def _word(self, stream: Bytes, at: NDArray[np.int64], place: tuple[int, int]) -> NDArray[np.int64]:
        return (stream[at + place[0]] + 256 * stream[at + place[0] + 1].astype(np.int64)) & place[1]


def joined(key: FloatArray, other: FloatArray, values: FloatArray) -> FloatArray:
    """Look up values ``(m, ...)`` by key: ``NaN`` without a match, the last one of several matches.

    `key` (n,): keys of the requested rows. `other` (m,): keys of `values`.
    """
    result = np.full((len(key), *values.shape[1:]), np.nan)
    if len(other):
        order = np.argsort(other, kind="stable")
        place = np.searchsorted(other[order], key, side="right") - 1
        matched = (place >= 0) & (other[order][place] == key)
        result[matched] = values[order[place[matched]]]
    return result


def at_times(wanted: FloatArray, time: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate values ``(m,)`` from `time` to `wanted` ``(n,)``; NaN outside, and in gaps of over five intervals."""
    order = np.argsort(time, kind="stable")
    time, values = time[order], values[order]
    if len(time) < 2:
        return np.full(len(wanted), np.nan)
    steps = np.diff(time)
    interval = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    following = np.clip(np.searchsorted(time, wanted, side="right"), 1, len(time) - 1)
    interpolated = np.interp(wanted, time, values, left=np.nan, right=np.nan)
    return np.where(steps[following - 1] <= 5.5 * interval, interpolated, np.nan)
