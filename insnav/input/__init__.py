"""Input of recordings: files are read, and their interpretation is kept as data."""

from __future__ import annotations

from insnav.input.interpret.overlap import check_overlap
from insnav.input.readers.imu import read_imu
from insnav.input.readers.positions import read_gps, read_reference
from insnav.input.readers.reading import Reading, ReadingFacts

__all__ = ["Reading", "ReadingFacts", "check_overlap", "read_gps", "read_imu", "read_reference"]
