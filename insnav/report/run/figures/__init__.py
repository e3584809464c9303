"""Figures of a run: track, states, innovations, sensor errors, and errors against a reference."""

from __future__ import annotations

from insnav.report.run.figures.all_figures import draw_all

__all__ = ["draw_all"]
