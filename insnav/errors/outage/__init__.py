"""Free-inertial windows and GNSS outages of a recorded drive: one study of how its errors grow."""
