"""Message catalogues, ``messages/<language>.toml``, read once."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any


@cache
def catalogue(lang: str) -> Mapping[str, Any]:
    """Read the catalogue of a language."""
    return tomllib.loads((Path(__file__).parent / "messages" / f"{lang}.toml").read_text(encoding="utf-8"))
