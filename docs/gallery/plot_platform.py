"""
A day of a north-pointing platform
==================================

A platform at rest with a gyro drift of 0.01 deg/h: it swings with the Schuler period of 84 minutes, in a plane
that turns once in 34 hours at this latitude, and with the Earth once a day.
"""

import matplotlib.pyplot as plt
import numpy as np

from insnav.errors.schuler import periods, static_errors
from insnav.gimbal import PlatformErrors
from insnav.units import DEG, DEG_PER_H

time = np.linspace(0.0, 86400.0, 4000)
drift = PlatformErrors(drift=np.array([0.01, 0.0, 0.0]) * DEG_PER_H)
errors = static_errors(time, 45 * DEG, 0.0, drift)
figure, axes = plt.subplots()
axes.plot(time / 3600.0, errors.position / 1852.0, label=["north", "east"])
axes.set_xlabel("time [h]")
axes.set_ylabel("position error [NM]")
axes.set_title("North gyro drift of 0.01 deg/h at latitude 45 deg")
axes.legend()

# %%
found = periods(45 * DEG, 0.0)
print(f"Schuler {found.schuler / 60:.2f} min, Foucault {found.foucault / 3600:.2f} h, Earth {found.earth / 3600:.2f} h")
