"""Files in: recordings are read, and how they were understood is kept as data."""

from __future__ import annotations

from insnav.input.interpret.overlap import check_overlap
from insnav.input.readers.gps import read_gps
from insnav.input.readers.imu import read_imu
from insnav.input.readers.reading import Reading, ReadingFacts
from insnav.input.readers.reference import read_reference

__all__ = ["Reading", "ReadingFacts", "check_overlap", "read_gps", "read_imu", "read_reference"]
