"""
The gain of a fault over time
=============================

Two simulated city drives with one fault each: a gyro bias that steps by 0.1 deg/s, and fixes that drift away by 0.5 m/s
for a minute while their velocities stay correct. One backward pass over the linear record predicts the gain of every
kind of fault at every epoch. The theory is on the page "Faults of a recording".
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import insnav
from insnav.explain.kinds import KINDS, cost_of_end
from insnav.explain.proposals import SIZES, gains_of, score_kind
from insnav.explain.record import LinearRecord
from insnav.explain.search import ACCEPT, search
from insnav.filter.prepare import prepare
from insnav.filter.receiver import DELAY_SD, Delay, Receiver
from insnav.imu import load_imu

SHOWN = "offset", "drag", "velocity_offset", "heading", "gyro_z"
BEGIN = 200.0  # of either fault, after the first sample [s]

made = insnav.simulate("city", imu="automotive", gps="single", seed=5)
imu, gps = made.imu.data, made.gps.data
step = np.deg2rad(0.1) * (np.median(np.diff(imu.time)) if imu.sampling == "increment" else 1.0)
gyro = imu.gyro + step * np.outer(imu.time > imu.time[0] + BEGIN, [0.0, 0.0, 1.0])
dragged = insnav.simulate("city", imu="automotive", gps="single", seed=5, faults=["gps-drag:0.5m/s@200s+60s"])
drives = {
    "gyro z steps by 0.1 deg/s at 200 s": (replace(imu, gyro=gyro), gps),
    "fixes drift by 0.5 m/s from 200 s to 260 s": (imu, dragged.gps.data),
}

# %%
# The coloured lines are the gains of a single step without any fault in the model, priors included. The dashed lines
# mark the begin and the end of the fault that the search accepts. The grey line is the least gain that it accepts. The
# black line is the gain of a pair of opposite steps: a drift from the accepted begin to the time on the axis.

figure, axes = plt.subplots(2, 1, figsize=(8, 7), sharex=True, layout="constrained")
for axis, (name, (samples, fixes)) in zip(axes, drives.items(), strict=True):
    receiver = Receiver(delay=Delay(sd=DELAY_SD))
    record = next(LinearRecord.of(prepare(samples, fixes, load_imu("automotive"), receiver)[0]))
    found = search(record, KINDS)
    plain = search(record, ()).best  # without a fault
    seen, time = plain.seen, record.time - imu.time[0]
    for kind in (each for each in KINDS if each.name in SHOWN):
        gain, _ = score_kind(kind, *record.project(seen, kind), record.interval)
        axis.plot(time, gain, lw=1.2, label=kind.name.replace("_", " "))
    axis.axhline(ACCEPT, color="0.6", lw=0.8)
    for step in found.best.steps:
        columns, begin = record.columns(step.kind), step.begin
        size = np.linalg.norm(step.variance * record.project(found.best.seen, step.kind)[0][begin])
        ends = f", ends at {time[step.end]:.0f} s" if step.end else ""
        gain = plain.cost - found.best.cost
        print(f"{name}: {step.kind.name} at {time[begin]:.0f} s{ends}, size {size:.4g}, gain {gain:.0f}")
        for row in (step.begin, step.end):
            if row:
                axis.axvline(time[row], color="k", ls="--", lw=0.8)
        if step.end:
            rows = np.arange(begin + 2, begin + 150)
            score, information = record.project(seen, step.kind)
            cross = record.cross(seen, columns, begin, 150)[rows]
            both = information[begin] + information[rows] - cross - np.swapaxes(cross, 1, 2)
            variances = step.kind.size**2 * SIZES
            prior = step.kind.cost(variances, record.interval)[:, None] + cost_of_end(record.interval)
            pair = (gains_of(score[begin] - score[rows], both, variances) - prior).max(axis=0)
            axis.plot(time[rows], pair, "k", lw=1.2, label=f"drag from {time[begin]:.0f} s to the time on the axis")
    axis.set_title(name)
    axis.set_ylabel("gain [-]")
    axis.legend(fontsize=8)
axes[1].set_xlabel("time [s]")
