"""The recordings of the tests of the command line, for a notebook."""

from __future__ import annotations

from tests.cli.conftest import at_rest, drive, files

__all__ = ["at_rest", "drive", "files"]
