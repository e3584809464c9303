"""Why the errors of free-inertial windows are as they are: growth curves, sensor errors, simulated replicas."""
