"""Noise of an IMU from a static record: Allan deviation, noise model, IMU file."""
