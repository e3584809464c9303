"""Every message of the catalogues with its letters reversed, the numbers in their places.

``INSNAV_REVERSED=1 python -m pytest -m ""`` runs all tests with such messages: whatever fails depends on wording. Only
``tests/test_messages.py``, which tests the catalogue itself, may.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from typing import Any

from insnav import messages

_KEPT = re.compile(r"(\{[^}]*\}|\[\[|\]\])")


def reverse_text(text: str) -> str:
    """Reverse the letters between the numbers of a text."""
    return "".join(part if _KEPT.fullmatch(part) else part[::-1] for part in _KEPT.split(text))


def as_shown(text: str) -> str:
    """Return a part of a message, without numbers, as this process shows it."""
    return reverse_text(text) if "INSNAV_REVERSED" in os.environ else text


def reverse_messages() -> None:
    """Reverse all catalogues of this process."""
    read = messages.catalogue

    def reversed_catalogue(lang: str) -> Mapping[str, Any]:
        return {
            code: {name: reverse_text(text) for name, text in entry.items()} if code != "form" else entry
            for code, entry in read(lang).items()
        }

    messages.catalogue = reversed_catalogue  # type: ignore[assignment]
