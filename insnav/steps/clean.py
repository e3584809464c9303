"""Step 1: remove invalid data."""

from __future__ import annotations

from dataclasses import replace

from insnav.alignment.in_motion import first_motion, velocity
from insnav.exceptions import InputError
from insnav.filter.gates import UNUSABLE, Gates, without_frozen
from insnav.filter.gps_noise import with_sd
from insnav.filter.prepare import good_fixes
from insnav.findings import Finding
from insnav.spill import blocks
from insnav.steps import Model, Recording

SLOWEST = 2.5  # lowest sampling rate of an IMU for navigation [Hz]


def clean(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Refuse samples that are too far apart, and remove frozen fixes.

    Fixes without a standard deviation get their fix-to-fix scatter. It omits slow errors, which do not hide motion.

    Raises: InputError: the sampling rate is too low, or sensors stay zero in motion. AlignmentError: no good fix.
    """
    facts = recording.imu.facts
    if facts.rate_hz < SLOWEST:
        raise InputError("imu.too_slow", where=facts.path, interval_s=1.0 / facts.rate_hz)
    if recording.gps is None:
        return recording, model, ()
    fixes = with_sd(recording.gps.data)[0]
    for sensor, values in (("gyros", recording.imu.data.gyro), ("accelerometers", recording.imu.data.accel)):
        zero = not any(values[part].any() for part in blocks(len(values)))  # no error at rest, for coarse gyros
        if zero and first_motion(velocity(fixes), fixes.time[0]) is not None:
            raise InputError("imu.triad_zero", where=facts.path, sensor=sensor)
    moving = without_frozen(fixes, recording.imu.data)[0]
    moving = moving.rows(moving.position_sd[:, 0] < UNUSABLE)
    if moving.time.shape[0] == 0:
        good_fixes(fixes, Gates())  # raises an error if all fixes are bad
    return replace(recording, fixes_by_scatter=moving), model, ()
