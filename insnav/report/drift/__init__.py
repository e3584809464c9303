"""The report of the drift of gyros."""
