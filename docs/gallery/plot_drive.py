"""
Navigate and explore a drive
============================

The sample drive: a car in a town, with one GPS outage of 21 s and an exact reference. Only the files are given.
"""

import insnav

imu, gps, ref = insnav.sample_drive()
drive = insnav.load(imu, gps=gps, ref=ref)
print(drive)

# %%
# The data, before the navigation.

figure = drive.plot()

# %%
# The summary states how accurate the result is.

run = drive.navigate()
print(run.summary())

# %%
# Any figure of the report by its name.

figure = run.plot("position_error")

# %%
figure = run.plot("track")

# %%
# Tables are pandas frames, with the unit in the name of each column.

run.to_frame().describe().loc[["min", "mean", "max"], ["height_m", "vn_m_s", "ve_m_s", "heading_deg"]].round(2)
