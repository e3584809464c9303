"""The grades of IMU that insnav knows by name, from the least to the most accurate.

Each is one real part; its ``source`` says which figures its datasheet gives and which are assumed. Where a
datasheet leaves a choice, the same rules hold for all:

- a tolerance (+-) or a limit (<, also on an RMS) of a bias, a scale factor or an angle is read as two
  standard deviations;
- an error given as one standard deviation (1 sigma, RMS) and a noise density are taken as they stand;
- ``bias_instability`` is the standard deviation of the bias about its turn-on value over an hour of use. The
  lowest point of the Allan deviation is measured at constant temperature and would promise too much. So:
  the temperature coefficient times 5 K; where there is none, a tenth of the bias error over the full
  temperature range (as a standard deviation); where there is neither, a fifth of the turn-on bias. Never
  less than the lowest point of the Allan deviation over 0.664 (IEEE Std 952-1997, annex C). Its correlation
  time is assumed to be an hour.
"""

from __future__ import annotations

from pathlib import Path

PRESETS = ("consumer", "automotive", "industrial", "tactical", "navigation")
FOLDER = Path(__file__).parent / "grades"
