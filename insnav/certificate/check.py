"""What a certificate is made of: the error of each integrator against one limit."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Check:
    """One property of the numerics, measured against a closed form or a published value."""

    topic: str  # what is checked, such as ``coning``
    case: str  # on what
    unit: str  # of `limit` and `values`
    limit: float  # largest error allowed
    # integrator and its error. The limit applies to the first, which is navigated with; the others are to compare.
    values: tuple[tuple[str, float], ...]
    required: int = 1  # to how many of them the limit applies, from the first on

    @property
    def name(self) -> str:
        """Topic and case."""
        return f"{self.topic}: {self.case}"

    @property
    def error(self) -> float:
        """Largest of the errors to which the limit applies; NaN if one of them is."""
        errors = [value for _, value in self.values[: self.required]]
        return math.nan if any(math.isnan(value) for value in errors) else max(errors)

    @property
    def passed(self) -> bool:
        """Whether the error is within the limit; NaN is not."""
        return self.error <= self.limit
