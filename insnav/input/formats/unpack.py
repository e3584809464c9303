"""Compressed files: gzip, xz, bzip2, zstd, and ZIP archives, none of which may unpack to more than is sensible."""

from __future__ import annotations

import bz2
import io
import lzma
import mmap
import os
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from typing import Any, Protocol, cast

from insnav import spill
from insnav.exceptions import InputError, reason_of
from insnav.plain_text import plain_text

MAX_BYTES = 2 << 30  # of unpacked data
MAX_RATIO = 40  # of unpacked to packed, beyond RATIO_FROM: recordings have up to 15
RATIO_FROM = 128 << 20
MAX_FILES, MAX_DEPTH = 200_000, 6  # of a folder or an archive
_PIECE = 1 << 22


def refuse_bomb(where: str, kind: str, packed: int, size: int) -> None:
    """Refuse a file of so many bytes that becomes larger in memory than recordings do, before memory is taken."""
    if size > MAX_BYTES or (size > RATIO_FROM and size > MAX_RATIO * packed):
        raise InputError("format.bomb", where=where, kind=kind, packed_bytes=packed, size_bytes=size)


def refuse_sparse(where: str, found: os.stat_result) -> None:
    """Refuse a file that is nearly all holes; file systems without holes, or that do not count blocks, have none."""
    stored = 512 * getattr(found, "st_blocks", 0)
    if found.st_size > RATIO_FROM and 0 < stored < found.st_size / MAX_RATIO:
        raise InputError("format.bomb", where=where, kind="sparse", packed_bytes=stored, size_bytes=found.st_size)


class _Unpacker(Protocol):
    eof: bool
    unused_data: bytes

    def decompress(self, data: bytes, max_length: int, /) -> bytes: ...


# first bytes -> name, and how one member of such a file is unpacked
_KINDS: dict[bytes, tuple[str, Callable[[], Any]]] = {
    b"\x1f\x8b": ("gzip", lambda: zlib.decompressobj(31)),
    b"\xfd7zXZ": ("xz", lzma.LZMADecompressor),
    b"BZh": ("bzip2", bz2.BZ2Decompressor),
}
# what the libraries raise over damaged data; RuntimeError: it is encrypted, or of an unknown method
_DAMAGE = (zlib.error, lzma.LZMAError, OSError, EOFError, RuntimeError, ValueError, struct.error)
_ZSTD = b"\x28\xb5\x2f\xfd"


def unpacked(raw: bytes | mmap.mmap, name: str) -> bytes | mmap.mmap:
    """Bytes of a file without its compression, if it has one.

    Raises: InputError: it is damaged, cut off, or unpacks to more than is sensible.
    """
    head = raw[:6]
    kind, pieces = "zstd", None
    if head.startswith(_ZSTD):
        pieces = _zstd(raw)
    for magic, (word, start) in _KINDS.items():
        if head.startswith(magic):
            kind, pieces = word, _members(raw, start, word, name)
    if pieces is None:
        return raw

    def sensible(total: int = 0) -> Iterator[bytes]:
        for piece in pieces:
            total += len(piece)
            refuse_bomb(name, kind, len(raw), total)
            yield piece

    try:
        return spill.together(sensible())
    except _DAMAGE as error:
        reason = plain_text(reason_of(error))
        raise InputError("format.compressed_damaged", where=name, kind=kind, reason=reason) from error


def _members(raw: bytes | mmap.mmap, start: Callable[[], Any], kind: str, name: str) -> Iterator[bytes]:
    """Pieces of a file that may be glued together from several compressed ones."""
    unpacker = cast(_Unpacker, start())
    position, total, rest = 0, 0, b""
    while True:
        if not rest:
            rest = raw[position : position + _PIECE]
            position += len(rest)
        if unpacker.eof:
            rest = rest.lstrip(b"\0")
            if not rest and position >= len(raw):
                return
            unpacker = cast(_Unpacker, start())
        at_end = not rest
        piece = unpacker.decompress(rest, _PIECE)
        # what was not taken in: zlib hands it back, the others keep it
        rest = unpacker.unused_data if unpacker.eof else getattr(unpacker, "unconsumed_tail", b"")
        while piece and not unpacker.eof and not getattr(unpacker, "needs_input", True):
            total += len(piece)
            yield piece
            piece = unpacker.decompress(b"", _PIECE)
            rest = unpacker.unused_data if unpacker.eof else b""
        total += len(piece)
        yield piece
        if at_end and not piece and not unpacker.eof:
            raise InputError("format.compressed_cut", where=name, kind=kind, count=total)


def _zstd(raw: bytes | mmap.mmap) -> Iterator[bytes]:
    import pyarrow as pa

    with pa.CompressedInputStream(pa.BufferReader(pa.py_buffer(raw)), "zstd") as stream:
        while piece := stream.read(_PIECE):
            yield piece


def archive_members(raw: bytes | mmap.mmap, name: str) -> dict[str, Callable[[], bytes | mmap.mmap]]:
    """Files of a ZIP archive, without those that systems add, each to be unpacked when asked for."""
    try:
        archive = zipfile.ZipFile(io.BytesIO(raw[:]))
        entries = [entry for entry in archive.infolist() if not entry.is_dir()]
    except (zipfile.BadZipFile, *_DAMAGE) as error:
        raise InputError("format.zip_damaged", where=name, reason=plain_text(reason_of(error))) from error
    entries = [e for e in entries if not e.filename.startswith("__MACOSX/") and "/." not in f"/{e.filename}"]
    if len(entries) > MAX_FILES:
        raise InputError("format.too_many_files", where=name, limit_count=MAX_FILES)
    refuse_bomb(name, "ZIP", len(raw), sum(entry.file_size for entry in entries))
    return {entry.filename: _member(archive, entry, name) for entry in entries}


def _member(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, name: str) -> Callable[[], bytes | mmap.mmap]:
    def unpack() -> bytes | mmap.mmap:
        try:
            with archive.open(entry) as file:
                return spill.together(iter(lambda: file.read(_PIECE), b""))
        except (zipfile.BadZipFile, *_DAMAGE) as error:
            where = f"{name}: {plain_text(entry.filename)}"
            raise InputError("format.zip_damaged", where=where, reason=plain_text(reason_of(error))) from error

    return unpack
