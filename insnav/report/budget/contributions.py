"""Families of error sources: how large, how they grow, what they do, what they contribute and halving them saves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.errors.budget.error_budget import Budget
from insnav.errors.budget.sources import term_of
from insnav.report.numbers import number
from insnav.types import FloatArray
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


def horizontal(parts: FloatArray) -> FloatArray:
    """Horizontal position error, the root of N^2 + E^2, of ``(..., 9)`` [m]."""
    return np.hypot(parts[..., 0], parts[..., 1])


def ranked(budget: Budget) -> list[int]:
    """Families by what they make of the horizontal error in the end, the largest first."""
    last = budget.chosen[-1]
    size = horizontal(budget.covariance.parts[last])
    vertical = budget.covariance.parts[last, :, 2]
    return sorted(range(len(budget.families)), key=lambda k: (-size[k], -vertical[k]))


def shares(budget: Budget) -> FloatArray:
    """Part of each family in the variance of the horizontal error in the end, ``(f,)``."""
    square = horizontal(budget.covariance.parts[budget.chosen[-1]]) ** 2
    whole = float(square.sum())
    return np.asarray(square / whole if whole > 0.0 else square)


def saved(budget: Budget) -> FloatArray:
    """How much smaller the horizontal error in the end would be with half of each family, ``(f,)`` [m]."""
    whole = float(horizontal(budget.covariance.total[budget.chosen[-1]]))
    return np.asarray(whole * (1.0 - np.sqrt(1.0 - 0.75 * shares(budget))))


def source_texts(budget: Budget, chosen: Sequence[int], origin: str) -> tuple[str, ...]:
    """Say of some families how large they are and where that is from, what they do, and what half of them saves.

    `origin`: of the sizes that are of no start covariance.
    """
    last = budget.chosen[-1]
    whole, less = float(horizontal(budget.covariance.total[last])), saved(budget)
    texts = []
    for k in chosen:
        name, alone = budget.families[k], float(horizontal(budget.covariance.parts[last, k]))
        joint = any(source.joint and source.sd > 0.0 for source in budget.sources if source.family == name)
        where = "covariance of the filter at the start of the window" if joint else origin
        texts.append(
            f"{name}: {size(budget, name)} (1 sd; {where}). Alone {number(alone)} m after {budget.time[last]:g} s, "
            f"{100.0 * shares(budget)[k]:.1f} % of the variance; position error grows with {growth(budget, name)}: "
            f"{effect(name)}. Half of it: {number(whole)} -> {number(whole - float(less[k]))} m."
        )
    return tuple(texts)


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
