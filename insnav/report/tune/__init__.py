"""The report of the noise of an IMU from its drives."""
