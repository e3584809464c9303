"""
From volts to metres
====================

A gyro on a rate table gives volts. The fit gives scale factor and zero with their uncertainty. The remaining error of
the IMU causes a position error after a minute of navigation.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import insnav

rng = np.random.default_rng(7)
rate = np.arange(-100.0, 101.0, 10.0)
table = pd.DataFrame({"rate_dps": rate, "voltage_v": 0.0484 * rate + 0.164 + 0.002 * rng.standard_normal(len(rate))})
found = insnav.calibrate("gyro", table).found
for each in found.parameters:
    print(f"{each.label}: {each.value:.5f} ± {each.sd:.5f} {each.shown_unit}")

# %%
# The residuals of the line, as rates.

line = np.polynomial.Polynomial.fit(table["rate_dps"], table["voltage_v"], 1)
figure, axes = plt.subplots()
axes.plot(rate, (table["voltage_v"] - line(rate)) / line.deriv()(0.0), "o")
axes.axhline(0.0, color="0.6", lw=0.8)
axes.set_xlabel("rate of the table [deg/s]")
axes.set_ylabel("residual [deg/s]")
axes.set_title("Residuals of a straight line on a rate table")

# %%
# Position error after a minute, without and with the calibration.

for each in found.impact:
    print(f"{each.motion}: {each.without:.0f} m without the calibration, {each.corrected:.0f} m with it")
