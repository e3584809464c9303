"""
The noise of an IMU from a drive
================================

No IMU model is given. insnav estimates the noise of the IMU from the innovations of the fixes, with intervals. The
figure compares the estimates with the values of the simulation.
"""

import matplotlib.pyplot as plt

import insnav

made = insnav.simulate("city", imu="industrial", seed=4)
drive = insnav.load(made.imu.data, gps=made.fixes, noise="estimate")
run = drive.navigate()
print(run.summary())

# %%
# Each parameter that the drive determines, with its 95 % interval, as a multiple of the true value.

truth = {
    f"{group}.{key}": getattr(getattr(made.imu_spec, group), key).mean()
    for group in ("gyro", "accel")
    for key in ("random_walk", "bias_instability", "bias", "scale_factor")
}
figures = [each for each in run.found.noise.figures if each.observable and each.key in truth]
figure, axes = plt.subplots(figsize=(7, 0.5 * len(figures) + 1.5), layout="constrained")
for row, each in enumerate(figures):
    true = truth[each.key]
    axes.plot([each.low / true, each.high / true], [row, row], "C0", lw=3)
    axes.plot(each.value / true, row, "C0o")
axes.axvline(1.0, color="0.6", lw=0.8)
axes.set_xscale("log")
axes.set_yticks(range(len(figures)), [each.key.replace("_", " ").replace(".", ", ") for each in figures])
axes.set_xlabel("multiple of the simulated value")
axes.set_title("Noise of an industrial IMU, estimated from a city drive")
