"""The report of GNSS outages."""
