"""Inertial laboratory: calibrations and noise models from bench data, each with its uncertainty."""
