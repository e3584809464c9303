"""
Two ways to navigate a drive, side by side
==========================================

The sample drive without an IMU model, and with the model of its class. Fixes and reference are the same. Compare two
versions of insnav, or the trajectory of another program, in the same way from their folders.
"""

import insnav

imu, gps, ref = insnav.sample_drive()
found = insnav.load(imu, gps=gps, ref=ref).navigate()
preset = insnav.load(imu, gps=gps, ref=ref, imu="consumer", noise="model", lever_arm=(0.0, 0.0, 0.0)).navigate()
both = insnav.compare(found, preset, ref=ref)
print(both.summary())

# %%
figure = both.plot("horizontal_error")
