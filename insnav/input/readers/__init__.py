"""Recordings from files: IMU, receiver, reference, positions, raw outputs."""
