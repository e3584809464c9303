"""Files in and out: recordings are read here, with everything that was understood and done said."""

from __future__ import annotations

from insnav.io.facts import Reading, ReadingFacts
from insnav.io.gps import read_gps
from insnav.io.imu import read_imu
from insnav.io.overlap import check_overlap
from insnav.io.reference import read_reference

__all__ = ["Reading", "ReadingFacts", "check_overlap", "read_gps", "read_imu", "read_reference"]
