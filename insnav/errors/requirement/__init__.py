"""Inverse error budget: allowed size of each error for a limit on the position error after a time.

limit -> allocation (each source alone, a balanced set) -> verification (covariance, simulated runs)
      -> aided (GPS before the outage, aiding in it) -> parts, sensitivity
"""
