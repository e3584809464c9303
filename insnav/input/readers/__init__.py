"""Readers of recordings: IMU, receiver, reference, positions, raw outputs."""
