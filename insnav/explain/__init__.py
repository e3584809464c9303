"""Explanation of faults of fixes, clock and IMU: one linear record, one search, one criterion.

Data flow: `record` builds the linear error model of a filter run, and `kinds` defines the kinds of faults. `proposals`
predicts gains, and `search` selects faults by the evidence. `explanation` passes the faults to the filter.
"""
