"""Loosely coupled INS/GPS filter: error model, gates, guarded filterpy engine and resumable loop."""
