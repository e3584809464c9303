"""
A rate table of the laboratory
==============================

The bench table in ``trajectories/laboratory``: output of a gyro against the rate, with the fitted line, and the
residuals below. Points outside the linear range are left out.
"""

from pathlib import Path

import insnav

table = Path(insnav.sample_drive()[0]).parents[1] / "laboratory" / "gyro_rate_table.csv"
found = insnav.calibrate("gyro", table)
print(found.summary())

# %%
figure = found.plot("residuals")
