"""The reports of the calibrations."""
