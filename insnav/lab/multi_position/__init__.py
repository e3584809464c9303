"""Multi-position calibration, without a table."""
