"""Which faults of fixes, clock and IMU a recording contains: one linear record, one search, one criterion.

`record` makes the linear error model of one filter run at epoch rate; `kinds` lists what can go wrong, with a rate and
a size each; `proposals` reads from the scores of the smoother what would explain the record; `search` accepts what the
evidence supports; `mixture` keeps what the record cannot tell apart; `explanation` hands the result to the filter.
"""
