"""Detection of faults of the fixes, the clock and the IMU in a whole recording.

`record` linearises the errors of one filter run at its epochs. `kinds` defines the kinds of faults. `proposals`
predicts how much a fault would improve the likelihood. `search` accepts faults by their Bayesian evidence.
`explanation` converts the accepted faults to instructions for the filter.
"""
