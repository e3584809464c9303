"""Unsupported formats: identified by their first bytes, with advice."""

from __future__ import annotations

from insnav.exceptions import InputError

# first bytes -> description
_ARCHIVES = {b"Rar!": "a RAR archive", b"7z\xbc\xaf\x27\x1c": "a 7z archive"}
_DATA = {
    b"ARROW1": "an Arrow / Feather file",
    b"\x93NUMPY": "a NumPy .npy array",
    b"<": "XML or HTML (also GPX, KML)",
    b"\xd0\xcf\x11\xe0": "a spreadsheet",  # spreadsheet of Excel before 2007
}
_PICKLE, _RTCM = {b"\x80\x04\x95": "a Python pickle"}, {b"\xd3\x00": "an RTCM 3 stream"}
_OTHERS = {
    b"\x89PNG": "a PNG picture",
    b"\xff\xd8\xff": "a JPEG picture",
    b"GIF8": "a GIF picture",
    b"%PDF": "a PDF document",
    b"\x7fELF": "a program (ELF)",
    b"MZ\x90": "a Windows program",
}
_ALL = _ARCHIVES | _DATA | _PICKLE | _RTCM | _OTHERS
SHEETS = {"xl/workbook.xml", "xl/workbook.bin", "content.xml"}  # members of XLSX, XLSB and ODS files
_CONTROL = bytes(set(range(32)) - {9, 10, 11, 12, 13, 26, 27}) + b"\x7f"


def unsupported(head: bytes) -> str:
    """Identify an unsupported file by its first kilobytes; empty if it may be a table."""
    binary = len(head.translate(None, delete=_CONTROL)) < 0.95 * len(head)
    return next((what for magic, what in _ALL.items() if head.startswith(magic)), "binary data" if binary else "")


def refusal(head: bytes, name: str, suffixes: tuple[str, ...]) -> InputError:
    """Build the error for an unsupported file. `suffixes`: of the supported formats."""
    kind = unsupported(head)
    if kind in _ARCHIVES.values():
        return InputError("format.other_archive", where=name, kind=kind)
    if kind in _DATA.values():
        return InputError("format.other_data", where=name, kind=kind)
    if kind in _PICKLE.values():
        return InputError("format.pickle", where=name)
    if kind in _RTCM.values():
        return InputError("format.rtcm", where=name)
    return InputError("format.unknown", where=name, kind=kind, suffixes=suffixes)
