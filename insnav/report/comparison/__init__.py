"""The report of runs against one reference."""
