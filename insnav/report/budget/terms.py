"""Sources of an error budget in words: how large in field units, how they grow, what they do."""

from __future__ import annotations

from insnav.errors.budget.error_budget import Budget
from insnav.errors.budget.sources import term_of
from insnav.units import UNITS

# of what is no error of a sensor, by family: unit, how often it is integrated to position, what it does
_OTHERS = {
    "initial position": ("m", 0, "stays what it is"),
    "initial velocity": ("m/s", 1, "goes on: v t"),
    "initial tilt": ("deg", 2, "gravity shows in the level axes and is taken for motion: g φ t² / 2"),
    "initial heading": ("deg", 2, "turns every change of velocity: ψ Δv across, and nothing at constant velocity"),
    "gravity model": ("mGal", 2, "gravity that the model does not have is taken for motion: Δg t² / 2"),
    "timing offset": ("ms", 0, "late samples: τ times the change of velocity"),
    "timing drift": ("ppm", 0, "samples that come later and later"),
}
_POWERS = {0.0: "stays", 0.5: "t⁰·⁵", 1.0: "t", 1.5: "t¹·⁵", 2.0: "t²", 2.5: "t²·⁵", 3.0: "t³", 3.5: "t³·⁵", 4.0: "t⁴"}


def effect(family: str) -> str:
    """What a family of errors does to navigation, in words."""
    return _OTHERS[family][2] if family in _OTHERS else term_of(family).text


def extent(budget: Budget, family: str) -> tuple[float, float, str]:
    """Least and largest axis of a family in its field unit, and that unit."""
    values = [source.sd for source in budget.sources if source.family == family and source.sd > 0.0]
    unit = _OTHERS[family][0] if family in _OTHERS else term_of(family).unit
    return min(values) / UNITS[unit][1], max(values) / UNITS[unit][1], unit


def size(budget: Budget, family: str) -> str:
    """Size of a family in a field unit, from the least to the largest axis if they differ."""
    *ends, unit = extent(budget, family)
    shown = dict.fromkeys(f"{float(f'{value:.3g}'):g}" for value in ends)
    return f"{' to '.join(shown)} {unit}"


def growth(budget: Budget, family: str) -> str:
    """Power of the time with which a family makes position errors, at rest and within minutes."""
    source = next(each for each in budget.sources if each.family == family)
    if source.group == "timing":
        return "motion"
    order = _OTHERS[family][1] if family in _OTHERS else term_of(family).integrals
    more = {"ramp": 1.0, "white": -0.5, "random walk": 0.5, "quantisation": -1.5}.get(source.kind, 0.0)
    return _POWERS[order + more]
