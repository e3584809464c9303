"""Which findings are contradictions of fixes and IMU, and which of them an IMU in wrong axes shows."""

from __future__ import annotations

from insnav.findings import CONTRADICTIONS, NOT_MEASURED, OF_THE_IMU, Code, Severity, of_families


def test_changes_of_the_imu_are_those_that_wrong_axes_show():
    """Steps of biases, turns, gyro faults and steps of the delay; velocities, jumps and false fixes are none."""
    assert set(OF_THE_IMU) == {
        Code.CHANGE_GYRO_FAULT,
        Code.CHANGE_TURNED,
        Code.CHANGE_GYRO_BIAS,
        Code.CHANGE_ACCEL_BIAS,
        Code.CHANGE_DELAY,
    }


def test_contradictions_are_warnings_and_repeated_fixes_are_none():
    """A code more or less would change which drives a page says are contradicted."""
    given = of_families("given", "noise")  # what the user or the receiver gave is wrong
    assert OF_THE_IMU | given < CONTRADICTIONS
    assert not CONTRADICTIONS & NOT_MEASURED
    assert len(given) == 12
    assert len(CONTRADICTIONS) == 23
    assert all(code.severity is Severity.WARNING for code in CONTRADICTIONS | NOT_MEASURED)
