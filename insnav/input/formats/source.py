"""Access to the bytes of a data file: opened, decompressed within size limits, decoded, and with a digest."""

from __future__ import annotations

import bz2
import codecs
import difflib
import functools
import gzip
import hashlib
import io
import lzma
import mmap
import os
import stat
import struct
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

from insnav import spill
from insnav.exceptions import InputError, reason_of
from insnav.plain_text import plain_text

MAX_BYTES = 2 << 30  # largest accepted size of unpacked data [bytes]
MAX_RATIO = 40  # largest ratio of unpacked to packed size, above RATIO_FROM; recordings have up to 15
RATIO_FROM = 128 << 20
MAX_FILES, MAX_DEPTH = 200_000, 6  # largest numbers of files and levels in a folder or archive


def refuse_bomb(where: str, kind: str, packed: int, size: int) -> None:
    """Refuse a file that unpacks to more than recordings do, before allocating memory."""
    if size > MAX_BYTES or (size > RATIO_FROM and size > MAX_RATIO * packed):
        raise InputError("format.bomb", where=where, kind=kind, packed_bytes=packed, size_bytes=size)


# first bytes -> name and reader of a compression
_KINDS: dict[bytes, tuple[str, Callable[[Any], Any]]] = {
    b"\x1f\x8b": ("gzip", lambda file: gzip.GzipFile(fileobj=file)),
    b"\xfd7zXZ": ("xz", lzma.LZMAFile),
    b"BZh": ("bzip2", bz2.BZ2File),
    b"\x28\xb5\x2f\xfd": ("zstd", lambda file: _zstd(file)),
}
# errors of the libraries for damaged data; RuntimeError: data are encrypted, or the method is unknown
_DAMAGE = (zlib.error, lzma.LZMAError, OSError, EOFError, RuntimeError, ValueError, struct.error)


def unpacked(raw: bytes | mmap.mmap, name: str) -> bytes | mmap.mmap:
    """Decompress the bytes of a file, if compressed.

    Raises: InputError: it is damaged, truncated, or unpacks to an excessive size.
    """
    compression = next((reader for magic, reader in _KINDS.items() if raw[:6].startswith(magic)), None)
    if compression is None:
        return raw
    (kind, opened), total = compression, 0

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


HEAD_BYTES = 1 << 14  # first bytes of a file, by which its format is recognised
_PIECE = 1 << 22  # number of bytes that are processed together
_MAX_STREAM = 128 << 20  # largest size of a stream, which is held in memory; an hour at 400 Hz has 115 MB
_ZIP = b"PK\x03\x04"


@dataclass(frozen=True, slots=True)
class Source:
    """Data file in memory or mapped, or the files of a folder or an archive."""

    name: str  # printable name for the user
    sha256: str  # digest of the file on disk; empty for a folder, see `digest_of`
    data: bytes | mmap.mmap = b""  # decompressed bytes; empty for a folder or archive
    members: Mapping[str, Callable[[], Source]] = field(default_factory=dict)  # files of a folder or archive, by path
    path: Path | None = None  # location on disk, if stored unchanged

    @property
    def head(self) -> bytes:
        """First bytes, to recognise formats."""
        return self.data[:HEAD_BYTES]


def open_source(path: str | Path) -> Source:
    """Open a data file, also compressed, standard input (``-``), or the files of a folder or archive.

    An archive with a single file is opened as this file.
    Raises: InputError: it cannot be read, is empty, or decompresses to an excessive size.
    """
    if str(path) == "-":
        return _source("standard input", _stream(sys.stdin.buffer, "standard input"))
    name = plain_text(path)
    try:
        raw = _read_file(Path(path), name)
    except IsADirectoryError:
        return Source(name, "", members=_folder_members(Path(path), name), path=Path(path))
    return _source(name, raw, Path(path))


def digest_of(sources: Iterable[Source]) -> str:
    """Compute the joint digest of several files."""
    return hashlib.sha256("".join(source.sha256 for source in sources).encode()).hexdigest()


@contextmanager
def on_disk(source: Source, suffix: str = "") -> Iterator[Path]:
    """Provide a path for libraries that open files; other data are written to a temporary folder.

    `suffix`: required ending of the name.
    """
    if source.path is not None and source.path.name.endswith(suffix):
        yield source.path
        return
    with tempfile.TemporaryDirectory(prefix="insnav-") as folder:
        place = Path(folder) / f"recording{suffix}"
        if not source.members:
            place.write_bytes(source.data)
        for inner, member in source.members.items():
            parts = PurePosixPath(inner.replace("\\", "/")).parts
            if ".." not in parts and not inner.startswith("/"):
                target = place.joinpath(*parts)
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(member().data)
        yield place


def _source(name: str, raw: bytes | mmap.mmap, path: Path | None = None, depth: int = 0) -> Source:
    if depth > MAX_DEPTH:
        raise InputError("format.nested_archives", where=name, limit_count=MAX_DEPTH)
    if len(raw) == 0:
        raise InputError("format.empty", where=name)
    if not raw[:HEAD_BYTES].strip(b"\0"):  # before reading on: a sparse file of zeros may have any size
        raise InputError("format.begins_with_zeros", where=name)
    digest = hashlib.sha256()
    for start in range(0, len(raw), _PIECE):
        digest.update(memoryview(raw)[start : start + _PIECE])
        spill.release()
    data = unpacked(raw, name)
    if data[:4] != _ZIP:
        return Source(name, digest.hexdigest(), data, path=path if data is raw else None)
    packed = archive_members(data, name)
    if len(packed) == 1:
        (inner, unpack) = packed.popitem()
        return _source(f"{name}/{plain_text(inner)}", unpack(), depth=depth + 1)

    def member(inner: str) -> Source:
        return _source(f"{name}/{plain_text(inner)}", packed[inner](), depth=depth + 1)

    return Source(name, digest.hexdigest(), members={inner: functools.partial(member, inner) for inner in packed})


def _folder_members(folder: Path, name: str) -> dict[str, Callable[[], Source]]:
    members: dict[str, Callable[[], Source]] = {}
    for place, folders, files in os.walk(folder):
        inner = Path(place).relative_to(folder)
        folders[:] = [] if len(inner.parts) >= MAX_DEPTH else sorted(f for f in folders if not f.startswith("."))
        for file in sorted(files):
            if not file.startswith("."):
                members[(inner / file).as_posix()] = functools.partial(open_source, Path(place) / file)
        if len(members) > MAX_FILES:
            raise InputError("format.too_many_files", where=name, limit_count=MAX_FILES)
    if not members:
        raise InputError("format.empty_folder", where=name)
    return members


def text_of(source: Source) -> tuple[bytes | mmap.mmap, int]:
    """Return the text of a file in UTF-8 or Latin-1 with line feeds, and the number of zero bytes after it."""
    text, zeros = _without_zeros(decoded(source.data))
    if len(text) == 0:
        raise InputError("format.only_zeros", where=source.name, count=zeros)
    return text, zeros


def _read_file(path: Path, name: str) -> bytes | mmap.mmap:
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError
        with path.open("rb") as file:
            status = path.stat()
            if not stat.S_ISREG(mode) or status.st_size == 0:
                return _stream(file, name)
            if disk_bytes := 512 * getattr(status, "st_blocks", 0):  # if the file system reports sparse blocks
                refuse_bomb(name, "sparse", disk_bytes, min(status.st_size, MAX_BYTES))
            return spill.watched(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except IsADirectoryError:
        raise
    except FileNotFoundError as error:
        raise _no_file(path, name) from error
    except (OSError, ValueError) as error:
        raise InputError("format.unreadable", where=name, reason=reason_of(error)) from error


def _stream(file: BinaryIO, name: str) -> bytes:
    """Read a stream to its end; refuse a stream above the size limit."""
    data = file.read(_MAX_STREAM + 1)
    if len(data) > _MAX_STREAM:
        raise InputError("format.endless_stream", where=name, limit_megabytes=_MAX_STREAM >> 20)
    return data


def _no_file(path: Path, name: str) -> InputError:
    """Build the error for a missing file, with a similar existing name."""
    folder = path.parent
    try:
        names = [p.name for p in folder.iterdir()]
    except OSError:
        return InputError("format.no_folder", where=name, folder=plain_text(folder))
    close = difflib.get_close_matches(path.name, names, n=1, cutoff=0.7)
    return InputError("format.no_file", where=name, close=plain_text(folder / close[0]) if close else "")


def decoded(raw: bytes | mmap.mmap) -> bytes | mmap.mmap:
    """Convert UTF-16 to UTF-8, and single carriage returns to line feeds."""
    head = raw[:HEAD_BYTES]
    encoding = ""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    elif len(head) >= 4 and head[1::2].count(0) > 0.9 * len(head[1::2]) and head[::2].count(0) == 0:
        encoding = "utf-16-le"
    elif len(head) >= 4 and head[::2].count(0) > 0.9 * len(head[::2]) and head[1::2].count(0) == 0:
        encoding = "utf-16-be"
    if encoding:
        raw = raw[:].decode(encoding, errors="replace").encode()
        head = raw[:HEAD_BYTES]
    if head.startswith(codecs.BOM_UTF8):
        raw = raw[len(codecs.BOM_UTF8) :]
    if b"\r" in head and b"\n" not in head:
        raw = raw[:].replace(b"\r", b"\n")
    return raw


def _without_zeros(raw: bytes | mmap.mmap) -> tuple[bytes | mmap.mmap, int]:
    """Remove zero bytes at the end, which loggers leave at power loss; also return their number."""
    if raw[-1:] != b"\0":
        return raw, 0
    end = len(raw)
    while end > 0:  # in pieces, since a file that ends with zeros may be large
        start = max(0, end - _PIECE)
        kept = len(raw[start:end].rstrip(b"\0"))
        end = start + kept
        spill.release()
        if kept:
            break
    return raw[:end], len(raw) - end
