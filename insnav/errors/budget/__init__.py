"""The error budget of free-inertial navigation: how much, after how long, from what.

sources -> analytic (short laws on paper) | covariance (the whole linear model) | montecarlo (what really happens)
        -> Budget
"""

from __future__ import annotations

from insnav.errors.budget.covariance import Covariance, covariance
from insnav.errors.budget.error_budget import Budget, Column, RecordedColumn, SimulatedColumn, budget, check_times
from insnav.errors.budget.initial_covariance import beside_known, known_sources
from insnav.errors.budget.sampled_motion import SampledMotion, at_rest, first_movement, sampled
from insnav.errors.budget.simulated import Runs, free_runs
from insnav.errors.budget.sources import Source, families, sources_of

__all__ = [
    "Budget",
    "Column",
    "Covariance",
    "RecordedColumn",
    "Runs",
    "SampledMotion",
    "SimulatedColumn",
    "Source",
    "at_rest",
    "beside_known",
    "budget",
    "check_times",
    "covariance",
    "families",
    "first_movement",
    "free_runs",
    "known_sources",
    "sampled",
    "sources_of",
]
