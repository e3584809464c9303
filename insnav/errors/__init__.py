"""Errors of a navigation solution: against a reference, and whether its stated uncertainty is true."""
