"""
Without GPS, with and without the non-holonomic constraint
==========================================================

Outages are simulated all over a drive, with the non-holonomic constraint (a car does not slide sideways) and
without it.
"""

import matplotlib.pyplot as plt

import insnav

drive = insnav.simulate("city", imu="automotive", seed=3)
figure, axes = plt.subplots()
for aiding, label in (("off", "IMU alone"), ("on", "with NHC and ZUPT")):
    growth = drive.outage(lengths=(5, 10, 20, 30), spacing=40.0, aiding=aiding, workers=1).found.growth
    horizontal = [each.rms[-1, each.components.index("horizontal")] for each in growth]
    axes.plot([each.length for each in growth], horizontal, "o-", label=label)
axes.set_xlabel("length of the outage [s]")
axes.set_ylabel("horizontal error at its end, RMS [m]")
axes.set_title("City drive, automotive IMU: outages with and without other aiding")
axes.legend()
