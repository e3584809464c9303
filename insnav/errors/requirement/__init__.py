"""The error budget backwards: how large each error may be for a limit on the position error after a time.

limit -> allocation (each source alone, a balanced set) -> verification (covariance, simulated runs)
      -> aided (GPS before the outage, aiding in it) -> parts, sensitivity
"""
