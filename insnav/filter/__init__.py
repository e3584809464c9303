"""Loosely coupled INS/GPS filter: error model, gates, guarded filterpy engine and resumable loop."""

from insnav.filter.error_model import ErrorModel, InitialState, error_model, initial_state
from insnav.filter.gates import Gates
from insnav.filter.navigator import Navigator
from insnav.filter.settings import FilterSettings

__all__ = ["ErrorModel", "FilterSettings", "Gates", "InitialState", "Navigator", "error_model", "initial_state"]
