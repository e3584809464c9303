"""Other programs on the same drives."""
