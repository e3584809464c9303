"""How much larger errors are in the field than figures of an IMU predict: the outcome of ``reports/published.md``."""

from __future__ import annotations

TYPICAL = 1.6  # geometric mean of recorded over predicted error
SPAN = (0.53, 4.9)  # 95 % of further tests
TEXT = (
    f"Field factor: recorded errors are typically {TYPICAL:g} times those predicted from the figures of an IMU, "
    f"between {SPAN[0]:g} and {SPAN[1]:g} times (95 % of tests; reports/published.md)."
)
