"""Interpretation of table columns: names, units, axes, order, overlap."""
