"""The reports of simulated recordings, one or many."""
