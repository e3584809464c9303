"""Figures of a run: track, states, innovations, sensor errors, and errors against a reference."""
