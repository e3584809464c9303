"""
Two ways to navigate a drive, side by side
==========================================

The sample drive with nothing given, and with the IMU taken for what its class is: the same fixes, the same reference.
Two versions of insnav, or another program's trajectory, are compared in the same way from their folders.
"""

import insnav

imu, gps, ref = insnav.sample_drive()
found = insnav.load(imu, gps=gps, ref=ref).navigate()
preset = insnav.load(imu, gps=gps, ref=ref, imu="consumer", noise="model", lever_arm=(0.0, 0.0, 0.0)).navigate()
both = insnav.compare(found, preset, ref=ref)
print(both.summary())

# %%
figure = both.plot("horizontal_error")
