"""
A day of a north-pointing platform
==================================

A platform at rest with a gyro drift of 0.01 deg/h: it swings with the Schuler period of 84 minutes, in a plane
that turns once in 34 hours at this latitude, and with the Earth once a day.
"""

import numpy as np
import pandas as pd

import insnav

time = np.arange(0.0, 86401.0, 2.0)
force = pd.DataFrame({"time_s": time, "f_east_m_s2": 0.0, "f_north_m_s2": 0.0, "f_up_m_s2": 9.806})
drift = {"drift": np.radians([0.01, 0.0, 0.0]) / 3600.0}
day = insnav.platform(force, np.radians(45.0), 0.0, errors=drift, interval=60.0)
figure = day.plot("errors")

# %%
print(day.summary())
