"""The report of the noise of a static record, or of signals."""
