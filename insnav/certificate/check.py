"""What a certificate is made of: one figure of each integrator against one bar."""

from __future__ import annotations

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
    """

    topic: str
    case: str
    unit: str
    bar: float
    values: tuple[tuple[str, float], ...]

    @property
    def passed(self) -> bool:
        """Whether the first integrator keeps the bar; an error that is no number does not."""
        return self.values[0][1] <= self.bar
