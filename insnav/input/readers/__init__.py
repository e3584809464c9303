"""Readers of recordings: IMU data, fixes, references, specific force, heights, and logs of further sensors."""
