"""What each family of sources contributes to the horizontal error, and what halving it would save."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.errors.budget.error_budget import Budget
from insnav.report.budget.terms import effect, growth, size
from insnav.report.numbers import number
from insnav.types import FloatArray


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
