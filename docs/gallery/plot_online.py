"""
Navigate while the data arrive
==============================

A recorded drive is replayed as in a vehicle: ten samples at a time, and each fix a third of a second late. With
``SPEED = 1`` the replay takes as long as the drive.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

import insnav

SPEED = np.inf  # 1: the drive's own
DELAY = 0.3  # of the fixes on their way [s]

drive = insnav.simulate("city", imu="automotive", gps="single", seed=1)
imu, gps, truth = drive.imu.data, drive.gps.data, drive.reference.data
nav = insnav.OnlineFilter(imu="automotive", lever_arm=(0.0, 0.0, 0.0), gps_delay=0.0)

# %%
# The states are kept as they were at the time. No later fix changes them.

states, fix, began = [], 0, time.monotonic()
for first in range(0, imu.time.size, 10):
    rows = slice(first, first + 10)
    now = imu.time[rows][-1]
    time.sleep(max(0.0, (now - imu.time[0]) / SPEED - (time.monotonic() - began)))
    nav.imu(imu.time[rows], imu.gyro[rows], imu.accel[rows])
    while fix < gps.time.size and gps.time[fix] + DELAY <= now:
        sd = [*gps.position_sd[fix], *gps.velocity_sd[fix]]
        nav.gps(gps.time[fix], gps.lla[fix], gps.v_n[fix], sd)
        fix += 1
    states.append(nav.state)

aligned = [state for state in states if state.aligned]
print(f"aligned {aligned[0].time:.0f} s after the first sample, {len(aligned)} states")

# %%
# The track, and the error of the heading with three standard deviations.

lla = np.array([state.lla for state in aligned])
at = np.array([state.time for state in aligned])
error = np.array([state.rph[2] for state in aligned]) - np.interp(at, truth.time, np.unwrap(truth.rph[:, 2]))
error = np.degrees((error + np.pi) % (2.0 * np.pi) - np.pi)
sd = np.degrees([state.sd[8] for state in aligned])

figure, (track, heading) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
track.plot(*np.degrees(truth.lla[:, 1::-1]).T, color="0.7", label="truth")
track.plot(*np.degrees(lla[:, 1::-1]).T, label="online")
track.set(xlabel="longitude [deg]", ylabel="latitude [deg]")
track.legend()
heading.fill_between(at, -3.0 * sd, 3.0 * sd, color="0.9", label="3 sd")
heading.plot(at, error, label="error")
heading.set(xlabel="time [s]", ylabel="heading [deg]")
heading.legend()
