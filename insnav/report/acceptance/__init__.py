"""The report of acceptance figures."""
