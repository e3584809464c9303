"""The inertial laboratory: bench data to calibrations and noise models, each with its uncertainty."""
