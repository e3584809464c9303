"""Drift of MEMS gyros: model, smoothing, and the noise before and after."""
