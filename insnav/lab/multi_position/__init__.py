"""Calibration by hand in many positions, without a table."""
