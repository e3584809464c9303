"""
From a static record to a noise model
=====================================

Two hours of a simulated gyro at rest: its Allan deviation, and the coefficients with their intervals.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import lfilter

from insnav import allan

DEG_PER_H, DEG_PER_SQRT_H = np.radians(1.0) / 3600.0, np.radians(1.0) / 60.0  # [rad/s], [rad/sqrt(s)]
rate, hours = 50.0, 2.0
rng = np.random.default_rng(7)
n = int(hours * 3600 * rate)
white = 0.3 * DEG_PER_SQRT_H * np.sqrt(rate) * rng.standard_normal(n)
keep = np.exp(-1.0 / (300.0 * rate))
in_run = 8.0 * DEG_PER_H * lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(n))
found = allan(white + in_run, rate=rate).found
(model,) = found.models
for name, each in model.coefficients.items():
    print(f"{name:3} {each.value:.3g}  (95 %: {each.low:.3g} ... {each.high:.3g}), SI units")

# %%
figure, axes = plt.subplots()
axes.loglog(found.allan.tau, found.allan.deviation[:, 0] / DEG_PER_H, ".", label="record")
axes.loglog(found.allan.tau, np.sqrt(model.variance) / DEG_PER_H, label="model")
axes.set_xlabel("averaging time [s]")
axes.set_ylabel("Allan deviation [deg/h]")
axes.set_title("Two hours at rest: random walk 0.3 deg/√h, in-run bias 8 deg/h with 300 s")
axes.legend()
axes.grid(which="both", alpha=0.3)
