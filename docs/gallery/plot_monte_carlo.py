"""
Monte Carlo against covariance
==============================

A budget has a linear estimate, the covariance, and an estimate from simulated runs of the full navigator. If the linear
model is valid, both agree within the band of the simulated runs.
"""

import matplotlib.pyplot as plt
import numpy as np

import insnav

made = insnav.simulate("city", imu="tactical", gps="rtk", seed=1)
result = made.budget(times=(10.0, 20.0, 30.0, 40.0, 50.0, 60.0), runs=200, seed=1)
figure = result.plot("growth")

# %%
# All sources together, and the 95 % band that 200 runs have around the truth.

budget = result.found.budget
ratio = budget.simulated.total[budget.chosen, :3] / budget.covariance.total[budget.chosen, :3]
figure, axes = plt.subplots()
axes.plot(budget.time[budget.chosen], ratio, "o-", label=["north", "east", "down"])
axes.axhspan(*budget.simulated.band, alpha=0.15, color="0.5", label="band of the runs")
axes.axhline(1.0, color="0.6", lw=0.8)
axes.set_xlabel("time without GPS [s]")
axes.set_ylabel("simulated / covariance")
axes.set_title("Position error of a tactical IMU in a town: 200 runs")
axes.legend()
print(f"largest difference {100 * np.abs(ratio - 1.0).max():.1f} %")
