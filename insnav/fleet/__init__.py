"""Fleets: many drives found, navigated on any engine, resumed, and compared on one page."""
