"""Aiding measurements besides GPS fixes: one file a kind, and the list of kinds in the order in which they are used."""

from __future__ import annotations

from insnav.filter.measurements.first_pass import FirstPass
from insnav.filter.measurements.height import HeightAiding
from insnav.filter.measurements.measurement import Measurement
from insnav.filter.measurements.non_holonomic import NonHolonomic
from insnav.filter.measurements.odometer import Odometer
from insnav.filter.measurements.zero_velocity import ZeroVelocity

KINDS: tuple[type[Measurement], ...] = (HeightAiding, ZeroVelocity, Odometer, NonHolonomic)


def measurements_from_drive(first: FirstPass) -> tuple[tuple[Measurement, ...], tuple[str, ...]]:
    """Every kind that the drive supports, in the order of use, and notes on all, the most important first."""
    found = [kind.from_drive(first) for kind in KINDS]
    return tuple(each for each, _ in found if each is not None), tuple(note for _, note in reversed(found) if note)
