"""Errors of a navigation solution against a reference, and tests of its stated uncertainty."""
