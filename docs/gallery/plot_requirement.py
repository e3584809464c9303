"""
Which IMU stays within 1 m for a minute
=======================================

The budget in reverse: from a limit on the position error after a time without GPS to the allowed sizes of the errors,
and to the real IMUs that keep the limit.
"""

import matplotlib.pyplot as plt

import insnav

found = insnav.require("1 m", "60 s", profile="city", runs=100, seed=1).found
print(found.required.text)
for share in found.allocation.shares:
    print(f"{share.family:22s} {100 * share.part:4.1f} % of the variance of a balanced set")

# %%
# The parts of ``insnav imus``, alone, after minutes of GPS: the best twelve.

best = sorted(found.candidates, key=lambda each: each.alone.error)[:12][::-1]
colours = {"yes": "C0", "likely": "C2", "open": "0.7", "no": "C1"}
figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for row, part in enumerate(best):
    axes.plot([part.alone.least, part.alone.error], [row, row], color=colours[part.alone.answer], lw=2)
    axes.plot(part.alone.error, row, "o", color=colours[part.alone.answer])
    axes.annotate(part.alone.answer, (part.alone.error, row), (8, -3), textcoords="offset points", fontsize=8)
axes.axvline(found.required.error, color="0.4", lw=0.8)
axes.set_xscale("log")
axes.set_yticks(range(len(best)), [part.name for part in best])
axes.set_xlabel("horizontal error after 60 s without GPS, 95 % [m]")
axes.set_title("City drive; bars: range of the undocumented figures")
