"""Files of the bench: tables, dwells and records."""
