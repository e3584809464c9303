"""The error budget of free-inertial navigation: how much, after how long, from what.

sources -> analytic (short forms on paper) | covariance (the whole linear model) | montecarlo (what really happens)
        -> Budget
"""
