"""A few faults of the injection script, put into a short drive: refused, found, or said, and never silent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.earth import lla_offset
from insnav.exceptions import InputError
from insnav.findings import Code
from insnav.simulate.recording import parse_fault
from insnav.units import DEG
from tests.faults.injection import OUTCOMES, Case, cases, clean, drive, navigated, outcome

OF_GYROS = {Code.CHANGE_GYRO_FAULT, Code.CHANGE_GYRO_BIAS}
WANTED = {
    "spike 1000m": "good",
    "first fix 300m": "told",
    "jump 30 s 300m": "told",
    "jump for good 500m": "warned",
    "drag with v 5.0": "warned",
    "drag 60 s 0.2m/s": "warned",
    "jump for good 20m": "warned",
    "jump for good 3m": "stated",  # half of the jump that the run itself states it would not show
    "sd factor 0.3": "warned",
    "clock back": "refused",
    "stuck gyro-z [s] 4": "told",
    "axes left-handed FLD": "told",
    "velocity ENU": "refused",
    "heights zero": "told",
}


def test_nothing_is_said_without_a_fault():
    assert clean("short").inside > 0.99
    assert not clean("short").said[0]


@pytest.mark.parametrize("name", WANTED)
def test_a_fault_is_never_silent(name):
    (case,) = [case for case in cases() if case.name == name]
    found = outcome("short", case)
    assert OUTCOMES.index(found.kind) >= OUTCOMES.index(WANTED[name]), found


def test_false_fixes_of_a_receiver_good_to_centimetres_are_no_gyro_fault():
    (case,) = [case for case in cases() if case.name == "jump 8 s 20m"]
    found = outcome("town", case)
    assert found.kind == "told"
    assert not found.codes & OF_GYROS


def test_fixes_of_which_gates_reject_all_are_refused():
    """By the noise that was found first, they rejected what it was to be found in again: a division by none."""

    def four_of_eight_aside(data):
        off = np.outer(np.arange(data.gps.time.size) // 4 % 2 == 0, [500.0, 0.0, 0.0])
        return data.imu, replace(data.gps, lla=lla_offset(data.gps.lla, off))

    found = outcome("positions", Case("N6", "four of eight 500m aside", four_of_eight_aside))
    assert found.kind == "refused", found
    assert found.codes & {Code.RUN_REJECTED, Code.RUN_CONTRADICTED}  # by gates, or by the explanation


def test_fixes_that_flap_leave_the_delay_and_are_told():
    """Gates rejected all of them, by a delay of false ones: refused, and before that a division by none."""
    flapping = parse_fault("gps-flap:500m@90s+60s")
    found = outcome("positions", Case("N6", "flapping 500m", lambda data: flapping.apply(data.imu, data.gps)))
    assert found.kind == "told", found
    assert found.inside > 0.99


def test_gyros_in_degrees_are_named_where_nothing_rests():
    data = drive("short")
    with pytest.raises(InputError, match="deg/s"):
        navigated(replace(data.imu, gyro=data.imu.gyro / DEG), data.gps, {})


@pytest.mark.parametrize("period", [604800.0, 86400.0])
def test_n20_a_week_or_a_day_that_ends_within_a_drive_changes_nothing(period):
    def counted(data, over):
        return replace(data, time=(data.time - drive("short").imu.time[0] + period - 100.0) % over)

    whole, wrapped = (
        navigated(counted(drive("short").imu, over), counted(drive("short").gps, over), {}).found.run.smoothed.solution
        for over in (1e9, period)
    )
    np.testing.assert_array_equal(whole.lla, wrapped.lla)
    np.testing.assert_array_equal(whole.time, wrapped.time)


def test_standard_deviations_of_a_hundredth_are_those_of_the_innovations():
    (case,) = [case for case in cases() if case.name == "sd factor 0.01"]
    found = outcome("short", case)
    assert found.kind == "told"
    assert Code.NOISE_SD_IMPLAUSIBLE in found.codes
    assert found.inside == 1.0
    assert found.largest < 1.4 * outcome("short", Case("N0", "none", lambda data: (data.imu, data.gps))).largest


@pytest.mark.parametrize("seconds", [20, 60])
def test_frozen_fixes_in_curves_are_named_and_left_out(seconds):
    """Precise fixes: weak at first they let the velocities of a curve be false, and a jump stood for all of it."""
    (case,) = [case for case in cases() if case.name == f"frozen [s] {seconds}"]
    found = outcome("figure", case)
    assert Code.GPS_FROZEN in found.codes
    assert found.kind == "told"
    assert found.largest < 1.0
