"""Error growth in free-inertial windows and GNSS outages of a recorded drive."""
