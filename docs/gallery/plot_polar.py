"""
Over the North Pole
===================

Ten minutes of a jet within 72 km of the pole, where the longitude jumps by 180 deg and north turns with it. The
position error stays small, because insnav computes in Earth-fixed axes there.
"""

import matplotlib.pyplot as plt
import numpy as np

import insnav

drive = insnav.simulate("over_the_pole", imu="navigation", seed=2)
truth = drive.reference.data
steps = insnav.increments(insnav.intervals(drive.imu.data))
found = insnav.navigate(steps, truth.lla[0], truth.v_n[0], truth.rph[0], every=10)
errors = insnav.position_errors(found, truth)
print(f"after {errors.time[-1] - errors.time[0]:.0f} s without GPS: {np.hypot(*errors.position[-1, :2]):.0f} m")

# %%
# The track from above the pole, the heading, and the error of free inertial navigation.

colatitude = np.degrees(0.5 * np.pi - found.lla[:, 0])
since = found.time - found.time[0]
figure, (left, middle, right) = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
left.plot(111.2 * colatitude * np.sin(found.lla[:, 1]), -111.2 * colatitude * np.cos(found.lla[:, 1]))
left.plot(0.0, 0.0, "k+", ms=12)
left.set_aspect("equal")
left.set_xlabel("along longitude 90 deg [km]")
left.set_ylabel("along longitude 180 deg [km]")
left.set_title("Track past the pole (+)")
middle.plot(since, np.degrees(np.unwrap(found.rph[:, 2])))
middle.set_xlabel("time [s]")
middle.set_ylabel("heading [deg]")
middle.set_title("North turns at the pole")
away = np.abs(errors.time - errors.time[0] - 300.0) > 5.0  # at the pole itself there is no north to resolve it in
horizontal = np.where(away, np.hypot(*errors.position[:, :2].T), np.nan)
right.plot(errors.time - errors.time[0], horizontal)
right.set_xlabel("time [s]")
right.set_ylabel("horizontal error [m]")
right.set_title("Free inertial, from an exact start")
