"""
From the laws of a minute to a budget
=====================================

Closed laws of the error of a minute, and what a change of each source would save.
"""

import matplotlib.pyplot as plt
import numpy as np

from insnav.errors.budget.laws import integral
from insnav.units import DEG_PER_H, DEG_PER_SQRT_H, G0, M_S_PER_SQRT_H

time = np.linspace(1.0, 60.0, 60)
sources = {
    "accelerometer bias 1 mg": 1e-3 * G0 * integral("constant", 2, time),
    "tilt 1 mrad": 1e-3 * G0 * integral("constant", 2, time),
    "gyro bias 10 deg/h": 10 * DEG_PER_H * G0 * integral("constant", 3, time),
    "accelerometer noise 0.1 m/s/√h": 0.1 * M_S_PER_SQRT_H * integral("white", 2, time),
    "gyro noise 0.3 deg/√h": 0.3 * DEG_PER_SQRT_H * G0 * integral("white", 3, time),
}
figure, axes = plt.subplots()
for name, error in sources.items():
    axes.loglog(time, error, label=name)
axes.set_xlabel("time without GPS [s]")
axes.set_ylabel("position error, one axis, 1 sd [m]")
axes.set_title("Laws of the first minute")
axes.legend()
axes.grid(which="both", alpha=0.3)
