"""Logs of bytes, made by the tests of the formats."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture
def save(tmp_path: Path) -> Callable[[bytes], Path]:
    """Write a log under a name that tells nothing."""

    def write(data: bytes) -> Path:
        path = tmp_path / "drive"
        path.write_bytes(data)
        return path

    return write
