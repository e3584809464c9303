"""Causes of errors in free-inertial windows: growth curves, sensor errors, simulated replicas."""
