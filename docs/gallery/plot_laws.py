"""
From the laws of a minute to a budget
=====================================

Closed laws of the position error in the first minute.
"""

import matplotlib.pyplot as plt
import numpy as np

DEG_PER_H, DEG_PER_SQRT_H, G0 = np.radians(1.0) / 3600.0, np.radians(1.0) / 60.0, 9.80665
time = np.linspace(1.0, 60.0, 60)
sources = {  # a constant integrated two or three times, and white noise
    "accelerometer bias 1 mg": 1e-3 * G0 * time**2 / 2.0,
    "tilt 1 mrad": 1e-3 * G0 * time**2 / 2.0,
    "gyro bias 10 deg/h": 10 * DEG_PER_H * G0 * time**3 / 6.0,
    "accelerometer noise 0.1 m/s/√h": 0.1 / 60.0 * np.sqrt(time**3 / 3.0),
    "gyro noise 0.3 deg/√h": 0.3 * DEG_PER_SQRT_H * G0 * np.sqrt(time**5 / 20.0),
}
figure, axes = plt.subplots()
for name, error in sources.items():
    axes.loglog(time, error, label=name)
axes.set_xlabel("time without GPS [s]")
axes.set_ylabel("position error, one axis, 1 sd [m]")
axes.set_title("Laws of the first minute")
axes.legend()
axes.grid(which="both", alpha=0.3)
