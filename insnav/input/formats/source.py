"""The bytes of a data file: found, unpacked, decoded, with their digest."""

from __future__ import annotations

import codecs
import difflib
import hashlib
import mmap
import stat
import sys
import zlib
from dataclasses import dataclass
from pathlib import Path

from insnav.exceptions import InputError
from insnav.plain_text import plain_text

HEAD_BYTES = 1 << 14  # what formats are recognised by
_MAX_BYTES = 2 << 30  # of unpacked data
_MAX_RATIO = 200  # of unpacked to packed, beyond _RATIO_FROM
_RATIO_FROM = 256 << 20
_PIECE = 1 << 22


@dataclass(frozen=True, slots=True)
class Source:
    """A data file in memory, or mapped to it."""

    name: str  # as the user knows it, fit to be printed
    sha256: str  # digest of the file as it is on the disk
    data: bytes | mmap.mmap  # its bytes, decompressed


def open_source(path: str | Path) -> Source:
    """Get the bytes of a data file, also compressed with gzip, or of standard input (``-``).

    Raises: IsADirectoryError: it is a folder; InputError: it cannot be read, is empty, or decompresses to more than is
    sensible.
    """
    if str(path) == "-":
        raw: bytes | mmap.mmap = sys.stdin.buffer.read()
        name = "standard input"
    else:
        name = plain_text(path)
        raw = _read_file(Path(path), name)
    if len(raw) == 0:
        raise InputError("the file is empty", where=name, why="0 bytes", fix="give the recording again")
    digest = hashlib.sha256(raw).hexdigest()
    return Source(name, digest, _gunzip(raw, name) if raw[:2] == b"\x1f\x8b" else raw)


def text_of(source: Source) -> tuple[bytes | mmap.mmap, int]:
    """Text of a file in UTF-8 or Latin-1 with line feeds, and the number of zero bytes that followed it."""
    text, zeros = _without_zeros(decoded(source.data))
    if len(text) == 0:
        raise InputError("the file has no content", where=source.name, why=f"{zeros} zero bytes and nothing else")
    return text, zeros


def _read_file(path: Path, name: str) -> bytes | mmap.mmap:
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError
        with path.open("rb") as file:
            if not stat.S_ISREG(mode) or path.stat().st_size == 0:
                return file.read()
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except IsADirectoryError:
        raise
    except FileNotFoundError as error:
        raise InputError("there is no such file", where=name, fix=_similar(path)) from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError("the file cannot be read", where=name, why=reason or str(error)) from error


def _similar(path: Path) -> str:
    folder = path.parent
    try:
        names = [p.name for p in folder.iterdir()]
    except OSError:
        return f"the folder {plain_text(folder)} does not exist or cannot be read"
    close = difflib.get_close_matches(path.name, names, n=1)
    return f"did you mean {plain_text(folder / close[0])}?" if close else "check the name and the folder"


def _gunzip(packed: bytes | mmap.mmap, name: str) -> bytes:
    pieces: list[bytes] = []
    total, position = 0, 0
    rest = b""
    unpacker = zlib.decompressobj(31)
    try:
        while True:
            if not rest:
                rest = packed[position : position + _PIECE]
                position += len(rest)
            if unpacker.eof:  # files may be glued together from several members
                rest = rest.lstrip(b"\0")
                if not rest and position >= len(packed):
                    return b"".join(pieces)
                unpacker = zlib.decompressobj(31)
            at_end = not rest
            piece = unpacker.decompress(rest, _PIECE)
            rest = unpacker.unused_data if unpacker.eof else unpacker.unconsumed_tail
            total += len(piece)
            pieces.append(piece)
            if at_end and not piece and not unpacker.eof:
                raise InputError(
                    "the gzip file is cut off",
                    where=name,
                    why=f"it ends after {total} unpacked bytes without its closing mark",
                    fix="copy it again, or unpack what is there: zcat FILE > FILE.csv",
                )
            if total > _MAX_BYTES or (total > _RATIO_FROM and total > _MAX_RATIO * len(packed)):
                raise InputError(
                    "the gzip file unpacks to more than is sensible",
                    where=name,
                    why=f"{len(packed)} bytes became more than {total}",
                    fix="if it is a real recording, unpack it with `gzip -d` and give the .csv",
                )
    except zlib.error as error:
        raise InputError("the gzip file is damaged", where=name, why=str(error), fix="copy it again") from error


def decoded(raw: bytes | mmap.mmap) -> bytes | mmap.mmap:
    """UTF-16 as UTF-8, and carriage returns alone as line feeds."""
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
    """Take off the zeros that a logger leaves at the end when its power goes."""
    if raw[-1:] != b"\0":
        return raw, 0
    end = len(raw)
    while end > 0:  # piece by piece: such a file may be mostly zeros, and large
        start = max(0, end - _PIECE)
        kept = len(raw[start:end].rstrip(b"\0"))
        end = start + kept
        if kept:
            break
    return raw[:end], len(raw) - end
