"""Published bench tables beside the project."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.shared import SHARED


def lab_file(name: str) -> Path:
    """Path of a table; the test is skipped where it is absent."""
    path = SHARED / "lab" / name
    if not path.is_file():
        pytest.skip(f"the published table {name} is not beside the project (../shared/lab)")
    return path
