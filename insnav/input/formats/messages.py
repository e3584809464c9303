"""Messages in a stream of bytes, found by their first bytes: whatever lies between them is passed over."""

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
_BLOCK = 1 << 25  # of messages looked at together [bytes]


def starts(data: bytes | mmap.mmap, first: bytes) -> NDArray[np.int64]:
    """Where given bytes stand in a stream, ``(n,)``."""
    return np.array([found.start() for found in re.finditer(re.escape(first), data)], dtype=np.int64)


def gathered(data: bytes | mmap.mmap, at: NDArray[np.int64], size: int) -> Bytes:
    """Messages of one size, a row each, ``(n, size)``; those that go beyond the end are left out."""
    stream = np.frombuffer(data, dtype=np.uint8)
    at = at[at <= len(stream) - size]
    return stream[at[:, None] + np.arange(size)] if len(at) else np.empty((0, size), dtype=np.uint8)


def layout(text: str, kind: str = "") -> np.dtype[Any]:
    """Layout of a record, little-endian: ``name:type`` of each field between blanks; `kind` where it has no type."""
    fields = (field.partition(":") for field in text.split())
    return np.dtype([(name, f"<{own or kind}") for name, _, own in fields])


def as_records(rows: Bytes, layout: np.dtype[Any]) -> NDArray[Any]:
    """Rows of bytes as records ``(n,)`` of a layout, which may be shorter than a row."""
    return np.ascontiguousarray(rows[:, : layout.itemsize]).view(layout)[:, 0]


@dataclass(slots=True)
class Messages:
    """Sound messages of a kind."""

    rows: list[Bytes] = field(default_factory=list)  # (n, size) each, by their size
    at: list[NDArray[np.int64]] = field(default_factory=list)  # where they stand in the stream
    damaged: int = 0

    def records(self, layout: np.dtype[Any], skip: int = 0) -> tuple[NDArray[Any], NDArray[np.int64]]:
        """Records ``(n,)`` behind a header of `skip` bytes, and their places, in the order of the stream."""
        long = [i for i, rows in enumerate(self.rows) if rows.shape[1] >= layout.itemsize + skip]
        found = [np.empty(0, dtype=layout), *(as_records(self.rows[i][:, skip:], layout) for i in long)]
        at = np.concatenate([np.empty(0, dtype=np.int64), *(self.at[i] for i in long)])
        order = np.argsort(at, kind="stable")
        return np.concatenate(found)[order], at[order]


@dataclass(frozen=True, slots=True)
class Framing:
    """How a protocol frames its messages: first bytes, number and size in the header, a checksum."""

    sync: bytes
    # where number and size stand, two bytes each, and which of their bits count
    number: tuple[int, int]
    size: tuple[int, int]
    around: int  # what a whole message has besides that size
    least: int  # size of the smallest message
    sound: Callable[[Bytes], NDArray[np.bool_]]  # whether the checksum of whole messages (n, size) is right

    def recognise(self, head: bytes) -> bool:
        """Whether a sound message begins in the first bytes of a file."""
        at = starts(head, self.sync)[:64]
        sizes = self._word(np.frombuffer(head + bytes(8), dtype=np.uint8), at, self.size) + self.around
        good = (sizes >= self.least) & (at + sizes <= len(head))
        messages = (gathered(head, at[i : i + 1], int(sizes[i])) for i in np.flatnonzero(good))
        return any(bool(self.sound(each)[0]) for each in messages)

    def find(self, data: bytes | mmap.mmap, numbers: Collection[int]) -> dict[int, Messages]:
        """Messages of these numbers."""
        stream = np.frombuffer(data, dtype=np.uint8)
        at = starts(data, self.sync)
        at = at[at <= len(stream) - self.least]
        kinds, sizes = self._word(stream, at, self.number), self._word(stream, at, self.size) + self.around
        found = {number: Messages() for number in numbers}
        for number, messages in found.items():
            mine = kinds == number
            for size in np.unique(sizes[mine]).tolist():
                some = at[mine & (sizes == size)]
                messages.damaged += len(some)
                step = max(1, _BLOCK // max(size, 1))  # in blocks, so that memory is bounded
                for first in range(0, len(some) if size >= self.least else 0, step):
                    block = some[first : first + step]
                    rows = gathered(data, block, size)
                    good = self.sound(rows)
                    messages.rows.append(rows[good])
                    messages.at.append(block[: len(rows)][good])
                    messages.damaged -= int(np.count_nonzero(good))
        return found

    def _word(self, stream: Bytes, at: NDArray[np.int64], place: tuple[int, int]) -> NDArray[np.int64]:
        return (stream[at + place[0]] + 256 * stream[at + place[0] + 1].astype(np.int64)) & place[1]


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
