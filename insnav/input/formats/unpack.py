"""Compressed files: gzip, xz, bzip2, zstd, and ZIP archives, with limits on the unpacked size."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import mmap
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from typing import Any

from insnav import spill
from insnav.exceptions import InputError, reason_of
from insnav.plain_text import plain_text

MAX_BYTES = 2 << 30  # of unpacked data
MAX_RATIO = 40  # of unpacked to packed, beyond RATIO_FROM: recordings have up to 15
RATIO_FROM = 128 << 20
MAX_FILES, MAX_DEPTH = 200_000, 6  # of a folder or an archive
_PIECE = 1 << 22


def refuse_bomb(where: str, kind: str, packed: int, size: int) -> None:
    """Refuse a file that unpacks to more than recordings do, before allocating memory."""
    if size > MAX_BYTES or (size > RATIO_FROM and size > MAX_RATIO * packed):
        raise InputError("format.bomb", where=where, kind=kind, packed_bytes=packed, size_bytes=size)


# first bytes -> name, and reader
_KINDS: dict[bytes, tuple[str, Callable[[Any], Any]]] = {
    b"\x1f\x8b": ("gzip", lambda file: gzip.GzipFile(fileobj=file)),
    b"\xfd7zXZ": ("xz", lzma.LZMAFile),
    b"BZh": ("bzip2", bz2.BZ2File),
    b"\x28\xb5\x2f\xfd": ("zstd", lambda file: _zstd(file)),
}
# errors of the libraries on damaged data; RuntimeError: encrypted, or of an unknown method
_DAMAGE = (zlib.error, lzma.LZMAError, OSError, EOFError, RuntimeError, ValueError, struct.error)


def unpacked(raw: bytes | mmap.mmap, name: str) -> bytes | mmap.mmap:
    """Decompress the bytes of a file, if compressed.

    Raises: InputError: it is damaged, truncated, or unpacks to an excessive size.
    """
    found = next((each for magic, each in _KINDS.items() if raw[:6].startswith(magic)), None)
    if found is None:
        return raw
    (kind, opened), total = found, 0

    def pieces() -> Iterator[bytes]:
        nonlocal total
        with opened(io.BytesIO(raw) if isinstance(raw, bytes) else raw) as file:
            while piece := file.read(_PIECE):
                total += len(piece)
                refuse_bomb(name, kind, len(raw), total)
                yield piece

    try:
        return spill.together(pieces())
    except EOFError as error:
        raise InputError("format.compressed_cut", where=name, kind=kind, count=total) from error
    except _DAMAGE as error:
        reason = plain_text(reason_of(error))
        raise InputError("format.compressed_damaged", where=name, kind=kind, reason=reason) from error


def _zstd(file: Any) -> Any:
    import pyarrow as pa

    buffer = pa.py_buffer(file if isinstance(file, mmap.mmap) else file.getbuffer())
    return pa.CompressedInputStream(pa.BufferReader(buffer), "zstd")


def archive_members(raw: bytes | mmap.mmap, name: str) -> dict[str, Callable[[], bytes | mmap.mmap]]:
    """List files of a ZIP archive, without system files, each unpacked on demand."""
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
