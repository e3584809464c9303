"""The report of the north-pointing platform."""
