"""
Poses of a camera at its triggers
=================================

A camera 3 m ahead of the IMU and 2 m to the right, triggered twice per second. The vehicle turns, so the camera takes
another path than the IMU. Each pose has its own standard deviation.
"""

import matplotlib.pyplot as plt
import numpy as np

import insnav

imu, gps, ref = insnav.sample_drive()
drive = insnav.load(imu, gps=gps, ref=ref, lever_arm=(0.8, -0.3, -1.2))
triggers = np.arange(100_155.37, 100_167.0, 0.5)
run = drive.navigate(epochs=triggers, point=(3.0, 2.0, -1.8)).found.run
poses, rows = run.poses, np.abs(run.smoothed.solution.time - triggers[:, None]).argmin(axis=1)
print(
    f"{len(poses.time)} poses, horizontal sd {np.hypot(*poses.sd[:, :2].T).mean():.2f} m, "
    f"heading sd {np.degrees(poses.sd[:, 8]).mean():.2f} deg"
)

# %%
# Camera and IMU from above. The arrows show the heading of the camera.


def east_north(lla):
    lat, lon, _ = poses.lla[0]
    return 6.378e6 * np.cos(lat) * (lla[:, 1] - lon), 6.37e6 * (lla[:, 0] - lat)


figure, axes = plt.subplots()
axes.plot(*east_north(run.smoothed.solution.lla[rows]), ".-", color="0.6", label="IMU")
heading = poses.rph[:, 2]
axes.quiver(*east_north(poses.lla), np.sin(heading), np.cos(heading), color="#0072B2", label="camera", width=4e-3)
axes.set_aspect("equal")
axes.set_xlabel("East of the first pose [m]")
axes.set_ylabel("North of the first pose [m]")
axes.legend()
