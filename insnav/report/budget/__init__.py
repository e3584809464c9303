"""The report of an error budget."""
