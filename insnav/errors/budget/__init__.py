"""Error budget of free-inertial navigation: size of the errors over time, and their sources.

sources -> analytic (closed laws) | covariance (the whole linear model) | simulated (Monte Carlo) | recorded (windows)
        -> Budget
"""
