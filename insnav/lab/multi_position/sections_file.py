"""Sections of a six-position record as somebody writes them down: first and last sample of each."""

from __future__ import annotations

import json
from pathlib import Path

from insnav.config_file import read_toml
from insnav.exceptions import ConfigError


def read_sections(path: Path) -> dict[str, tuple[int, int]]:
    """Sections of a record from a JSON or TOML file.

    path: ``{"x_p": {"start": 0, "end": 500}, …}`` or ``{"x_p": [0, 500], …}``. Returns first sample and last plus
    one. Raises ConfigError: it cannot be read or understood.
    """
    if path.suffix.lower() == ".toml":
        content = read_toml(path)
    else:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise ConfigError("cannot read the sections", where=str(path), why=str(error)) from None
    spans, wrong = {}, []
    for name, value in content.items() if isinstance(content, dict) else ():
        pair = [value.get("start"), value.get("end")] if isinstance(value, dict) else value
        if isinstance(pair, list) and len(pair) == 2 and all(type(item) is int for item in pair):
            spans[str(name)] = (pair[0], pair[1])
        else:
            wrong.append(str(name))
    if wrong or not spans:
        raise ConfigError(
            "the sections cannot be understood",
            where=str(path),
            why=f"no first and last sample of {', '.join(wrong) or 'anything'}",
            fix='write "x_p": {"start": 540, "end": 1271}',
        )
    return spans
