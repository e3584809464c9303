"""What a certificate is made of: one figure of each integrator against one bar."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Check:
    """One property of the numerics, measured against a closed form or a published value.

    Attributes
    ----------
    topic : str
        What is checked, such as ``coning``.
    case : str
        On what.
    unit : str
        Of `bar` and `values`.
    bar : float
        Largest error allowed.
    values : tuple of (str, float)
        Integrator and its error. The first is the one to navigate with and is judged; the others are there to compare.
    judged : int
        How many have to keep the bar, from the first on.
    """

    topic: str
    case: str
    unit: str
    bar: float
    values: tuple[tuple[str, float], ...]
    judged: int = 1

    @property
    def error(self) -> float:
        """Largest of the errors judged; not a number if one of them is none."""
        judged = [value for _, value in self.values[: self.judged]]
        return math.nan if any(math.isnan(value) for value in judged) else max(judged)

    @property
    def passed(self) -> bool:
        """Whether those judged keep the bar; an error that is no number does not."""
        return self.error <= self.bar
