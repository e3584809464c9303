"""Acceptance figures of gyros and accelerometers from bench records."""
