"""Aiding measurements of the filter, in addition to GPS fixes; the modules of this folder define them."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from insnav.filter.measurements.measurement import FirstPass, Measurement
from insnav.findings import Finding


@cache
def kinds() -> tuple[type[Measurement], ...]:
    """Return the classes of all aiding measurements, in the order of use."""
    modules = [importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
    classes = {
        value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, type) and value is not Measurement and hasattr(value, "from_drive")
    }
    return tuple(sorted(classes, key=lambda kind: kind.order))


def measurements_from_drive(first: FirstPass) -> tuple[tuple[Measurement, ...], tuple[Finding, ...]]:
    """Build all aiding measurements that the drive supports, in the order of use, and findings, the main one first."""
    calibrated = [kind.from_drive(first) for kind in kinds()]
    notes = tuple(note for _, note in reversed(calibrated) if note is not None)
    return tuple(each for each, _ in calibrated if each is not None), notes
