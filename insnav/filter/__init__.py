"""Loosely coupled INS/GPS: error model, gates, the filterpy engine behind its guards, and the resumable loop."""

from insnav.filter.error_model import ErrorModel, InitialState, error_model, initial_state
from insnav.filter.gates import Gates
from insnav.filter.navigator import Navigator
from insnav.filter.settings import FilterSettings

__all__ = ["ErrorModel", "FilterSettings", "Gates", "InitialState", "Navigator", "error_model", "initial_state"]
