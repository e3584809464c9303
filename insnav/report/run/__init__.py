"""The report of a navigated drive."""
