"""Drift of MEMS gyros: model, smoothing, and noise before and after."""
