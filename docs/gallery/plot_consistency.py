"""
Are the stated standard deviations true?
========================================

The same drive with six realisations of sensors and fixes. The normalised squared error (NEES) of the position should
be one on average, with 99.7 % of the errors inside three standard deviations.
"""

import matplotlib.pyplot as plt
import numpy as np

import insnav

shares, squares = [], []
for seed in range(1, 7):
    run = insnav.simulate("city", imu="industrial", seed=seed).navigate(aiding="off")
    errors = run.found.smoothed_errors
    ratio = errors.position / errors.sd[:, :3]
    shares.append(np.mean(np.abs(ratio) < 3.0))
    squares.append(np.mean(ratio**2))
print(f"smoothed position: NEES per axis {np.mean(squares):.2f}")
print(f"inside 3 sd: {100 * np.mean(shares):.1f} % (lowest {100 * min(shares):.1f} %)")

# %%
figure, axes = plt.subplots()
axes.plot(errors.time - errors.time[0], errors.position[:, 0], label="error, smoothed")
axes.fill_between(errors.time - errors.time[0], -3 * errors.sd[:, 0], 3 * errors.sd[:, 0], alpha=0.2, label="±3 sd")
axes.set_xlabel("time [s]")
axes.set_ylabel("north position error [m]")
axes.set_title("The last of the six: error and stated uncertainty")
axes.legend()
