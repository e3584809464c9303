"""The library of real IMUs."""
