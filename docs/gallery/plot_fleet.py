"""
A fleet of drives
=================

Four simulated drives of one car, navigated with one command. The GPS receiver of the last drive reports standard
deviations three times too small, and the fleet shows it.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import insnav

place = Path(tempfile.mkdtemp())
for seed, day in enumerate(("monday", "tuesday", "wednesday", "thursday"), 1):
    made = insnav.simulate("city", imu="automotive", seed=seed, rate=50.0)
    fixes = made.gps.data.to_frame()
    stated = [name for name in fixes if name.startswith("sd_")]
    fixes[stated] /= 3.0 if day == "thursday" else 1.0
    (place / day).mkdir()
    made.imu.data.to_frame().to_csv(place / day / "imu.csv", index=False)
    fixes.to_csv(place / day / "gps.csv", index=False)
command = [sys.executable, "-m", "insnav", "batch", str(place), "--out", str(place / "fleet"), "--imu", "automotive"]
print(subprocess.run(command, capture_output=True, text=True).stdout)

# %%
# Normalised innovations (NIS) of the positions of each drive, per axis: ideally 1. Above 1 the errors are larger than
# stated.

table = insnav.open_result(place / "fleet").to_frame()
figure, axes = plt.subplots()
axes.bar(table["drive"], table["nis_position"], color="#0072B2", width=0.6)
axes.axhline(1.0, color="#D55E00", lw=1.0)
axes.set_ylabel("NIS of the positions, per axis [-]")
