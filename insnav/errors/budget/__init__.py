"""The error budget of free-inertial navigation: how much, after how long, from what.

sources -> analytic (closed laws) | covariance (the whole linear model) | simulated (Monte Carlo) | recorded (windows)
        -> Budget
"""
