"""An error budget, with the windows of a recorded drive that it was compared with."""

from __future__ import annotations

from dataclasses import dataclass

from insnav.errors.budget.error_budget import Budget
from insnav.errors.budget.from_windows import RecordedBudget


@dataclass(frozen=True, slots=True)
class BudgetStudy:
    """A budget and the drive that it is of."""

    budget: Budget
    # free-inertial windows of the drive; None for a budget of a motion without a record
    windows: RecordedBudget | None = None
