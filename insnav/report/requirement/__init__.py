"""The report of a requirement."""
