"""The report of accuracy over versions."""
