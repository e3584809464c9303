"""Files in formats that are not read: named by their first bytes, with what to do about them."""

from __future__ import annotations

# first bytes -> what it is, and what to do about it
_MAGIC: tuple[tuple[bytes, str, str], ...] = (
    (b"\x89PNG", "a PNG picture", ""),
    (b"\xff\xd8\xff", "a JPEG picture", ""),
    (b"GIF8", "a GIF picture", ""),
    (b"%PDF", "a PDF document", ""),
    (b"\x7fELF", "a program (ELF)", ""),
    (b"MZ\x90", "a Windows program", ""),
    (b"Rar!", "a RAR archive", "unpack it"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", "unpack it"),
    (b"ARROW1", "an Arrow / Feather file", "save it as parquet or CSV"),
    (b"\x93NUMPY", "a NumPy .npy array", "save it as CSV with a header"),
    (b"\x80\x04\x95", "a Python pickle", "save it as CSV; pickles are never opened"),
    (b"\xd3\x00", "an RTCM 3 stream", "solve it first, e.g. with RTKLIB, and save the positions as CSV"),
    (b"<", "XML or HTML (also GPX, KML)", "convert it to CSV first"),
    (b"{", "JSON", "convert it to CSV first"),
)
_CONTROL = bytes(set(range(32)) - {9, 10, 11, 12, 13, 26, 27}) + b"\x7f"


def unsupported(head: bytes) -> tuple[str, str] | None:
    """Name a file that is no table by its first kilobytes, and what to do about it; None if it may be one."""
    for magic, what, fix in _MAGIC:
        if head.startswith(magic):
            return what, fix
    if len(head.translate(None, delete=_CONTROL)) < 0.95 * len(head):
        return "binary data of a kind not known here", ""
    return None
