"""GNSS outages all over a drive, and their errors summed up."""

from __future__ import annotations

from dataclasses import dataclass

from insnav.errors.outage.gnss_outage import Outage
from insnav.errors.outage.statistics import Growth


@dataclass(frozen=True, slots=True)
class OutageStudy:
    """Windows without fixes."""

    windows: tuple[Outage, ...]  # in order of length, then of time
    growth: tuple[Growth, ...]  # their errors, summed up by length
    reference: str  # what errors are against, in words
