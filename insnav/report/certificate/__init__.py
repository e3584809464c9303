"""The report of the numerical certificate."""
