"""
Lever arm from the drive
========================

The antenna of the sample drive is 0.8 m ahead of the IMU, 0.3 m to the left and 1.2 m above it. insnav estimates this
lever arm from the turns and accelerations of the drive. The longer the drive, the smaller the standard deviation.
"""

import matplotlib.pyplot as plt
import numpy as np

import insnav

imu, gps, ref = insnav.sample_drive()
samples, true = insnav.read_imu(imu).data, (0.8, -0.3, -1.2)
lengths = (120.0, 180.0, 240.0, 360.0, 480.0)
runs = [insnav.load(samples.beginning(each), gps=gps).navigate(smooth=False).found.run for each in lengths]
for length, run in zip(lengths, runs, strict=True):
    print(
        f"{length:.0f} s:", ", ".join(f"{x:.2f} ± {sd:.2f} m" for x, sd in zip(run.lever_b, run.lever_sd, strict=True))
    )

# %%
# Bars: two standard deviations. Lines: the true lever arm.

figure, axes = plt.subplots()
for k, (name, colour) in enumerate((("forward", "#0072B2"), ("right", "#D55E00"), ("down", "#009E73"))):
    arm, sd = np.transpose([(run.lever_b[k], run.lever_sd[k]) for run in runs])
    axes.errorbar(np.array(lengths) + 4.0 * k, arm, 2.0 * sd, fmt="o", color=colour, capsize=3.0, label=name)
    axes.axhline(true[k], color=colour, lw=0.8)
axes.set_xlabel("length of the drive [s]")
axes.set_ylabel("lever arm [m]")
axes.legend()
