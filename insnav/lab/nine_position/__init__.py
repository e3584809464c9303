"""Three dual-axis modules in nine positions of a table."""
