"""The report of many drives."""
