"""Aiding measurements besides GPS fixes: each module of this folder may define one kind."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from insnav.filter.measurements.measurement import FirstPass, Measurement
from insnav.findings import Finding


@cache
def kinds() -> tuple[type[Measurement], ...]:
    """Return the classes of all measurements, in the order of use."""
    modules = [importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
    found = {
        value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, type) and value is not Measurement and hasattr(value, "from_drive")
    }
    return tuple(sorted(found, key=lambda kind: kind.order))


def measurements_from_drive(first: FirstPass) -> tuple[tuple[Measurement, ...], tuple[Finding, ...]]:
    """Build all kinds that the drive supports, in the order of use, with findings, the most important first."""
    found = [kind.from_drive(first) for kind in kinds()]
    notes = tuple(note for _, note in reversed(found) if note is not None)
    return tuple(each for each, _ in found if each is not None), notes
