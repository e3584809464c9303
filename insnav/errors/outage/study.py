"""GNSS outages all over a drive, and their errors summed up."""

from __future__ import annotations

from dataclasses import dataclass

from insnav.errors.outage.gnss_outage import Outage
from insnav.errors.outage.statistics import Growth


@dataclass(frozen=True, slots=True)
class OutageStudy:
    """Windows without fixes.

    Attributes
    ----------
    windows : tuple of Outage
        In order of length, then of time.
    growth : tuple of Growth
        Their errors, summed up by length.
    reference : str
        What errors are against, in words.
    """

    windows: tuple[Outage, ...]
    growth: tuple[Growth, ...]
    reference: str
