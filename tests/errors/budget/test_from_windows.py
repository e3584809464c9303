"""The whole recorded budget: verdicts, notes, and replicas that agree with a right IMU file and with no other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insnav.errors.budget.from_windows import WindowSettings, recorded_budget, replica_task, verdicts
from insnav.errors.outage.free_inertial import (
    free_window_starts,
    free_windows,
    navigated_drive,
    reference_from_fixes,
    reference_from_trajectory,
)
from insnav.errors.outage.gnss_outage import COMPONENTS, components, growth
from insnav.exceptions import ConfigError
from insnav.findings import Code, Severity
from insnav.imu import ImuSpec
from insnav.simulate import reference
from tests.errors.outage import drives

FEW = WindowSettings(length=30.0, spacing=40.0, replicas=6, seed=3)


def scaled(spec: ImuSpec, factor: float) -> ImuSpec:
    def sensor(old):
        return replace(old, bias=factor * old.bias, random_walk=factor * old.random_walk)

    return replace(spec, gyro=sensor(spec.gyro), accel=sensor(spec.accel))


def test_both_kinds_of_windows_have_their_replicas():
    found = recorded_budget(drives.drawn(11), drives.SPEC, None, replace(FEW, replicas=3, uncalibrated=True))
    assert found.uncalibrated is not None
    raw, calibrated = found.uncalibrated.replicas, found.calibrated.replicas
    assert raw is not None
    assert calibrated is not None
    assert (raw.rms[:, -1, 5] > 3.0 * calibrated.rms[:, -1, 5]).all()
    alone = recorded_budget(drives.drawn(11), drives.SPEC, None, replace(FEW, replicas=3)).calibrated.replicas
    assert alone is not None
    np.testing.assert_array_equal(alone.rms, calibrated.rms)


def test_a_right_imu_file_agrees_with_its_replicas():
    agreed = []
    for seed in (11, 12, 13):
        found = recorded_budget(drives.drawn(seed), drives.SPEC, None, FEW)
        made = found.calibrated.replicas
        assert made is not None
        assert not made.failures
        print(f"recorded {made.recorded[-1, :3].round(3)} m, band {made.low[-1, :3].round(3)} to {made.high[-1, :3]}")
        agreed.append(made.agree)
        assert made.apart.position < 0.05
        assert made.apart.velocity < 0.1
    assert all(agreed)


def test_replicas_err_as_their_filter_predicts_and_their_fixes_as_stated():
    ready = drives.injected()
    stamps = free_window_starts(ready, 30.0, spacing=20.0)
    drive, against = navigated_drive(ready, stamps), reference_from_fixes(ready)
    windows = free_windows(drive, against, 30.0, 20.0)
    task = replica_task(drive, against, drives.SPEC, [windows], np.array([1.0, 10.0, 20.0, 30.0]))
    square, first = [], []
    for seed in range(8):
        (made,) = task.windows(seed)
        np.testing.assert_array_equal(made.start, windows.start)
        error, variance, own = components(made)
        square.append(np.mean(error[:, :, :2] ** 2 / (variance + own)[:, :, :2]))
        first.append(np.sqrt(np.mean(error[:, 0, :2] ** 2 / own[:, 0, :2])))
    print(f"mean square by prediction {np.mean(square):.2f}; after 1 s by the sd of a fix {np.mean(first):.2f}")
    assert 0.6 < np.mean(square) < 1.6
    assert 0.9 < np.mean(first) < 1.5


def test_an_imu_much_worse_than_its_file_does_not():
    found = recorded_budget(drives.drawn(11, scaled(drives.SPEC, 12.0)), drives.SPEC, None, FEW)
    made = found.calibrated.replicas
    assert made is not None
    assert not made.agree
    assert (made.recorded[-1, :3] > made.high[-1, :3]).any()


def test_replicas_are_the_same_for_any_number_of_workers():
    ready = drives.drawn(11)
    three = replace(FEW, replicas=3)
    first, second = (recorded_budget(ready, drives.SPEC, None, replace(three, workers=n)) for n in (1, 2))
    assert first.settings == second.settings  # kept with the result
    one, two = first.calibrated.replicas, second.calibrated.replicas
    assert one is not None
    assert two is not None
    np.testing.assert_array_equal(one.rms, two.rms)


def test_both_kinds_of_windows_and_what_is_said_of_them():
    absent = replace(drives.SPEC, absent=("gyro.scale_factor",))
    told: list[float] = []
    found = recorded_budget(
        drives.injected(), absent, None, WindowSettings(length=30.0, spacing=30.0, uncalibrated=True), told.append
    )
    assert found.uncalibrated is not None
    assert found.uncalibrated.windows.uncalibrated
    assert not found.calibrated.windows.uncalibrated
    np.testing.assert_array_equal(found.uncalibrated.windows.start, found.calibrated.windows.start)
    named = {each.code: each for each in found.notes}
    assert named[Code.BUDGET_OWN_FIXES].severity is Severity.ASSUMPTION
    assert named[Code.BUDGET_ABSENT]["terms"] == ("gyro.scale_factor",)
    assert Code.BUDGET_NO_STATIONARY_WINDOW in named
    assert Code.BUDGET_ALL_TURNING not in named
    assert told == sorted(told)
    assert told[-1] == 1.0
    # one specimen of a bias of 1 mg is what was predicted for many, give or take
    assert all(each.explained for each in found.uncalibrated.verdicts)


def test_a_smoothed_start_is_better_and_said_not_to_be_independent():
    ready = drives.injected()
    truth = reference_from_trajectory(
        reference(drives.motion(), ready.gps.time), "truth", position_sd=1e-3, velocity_sd=1e-3
    )
    forward, smoothed = (
        recorded_budget(ready, drives.SPEC, truth, WindowSettings(length=30.0, spacing=20.0, start=start))
        for start in ("forward", "smoothed")
    )
    at = COMPONENTS.index("horizontal")
    print(forward.calibrated.growth.corrected[-1, at], smoothed.calibrated.growth.corrected[-1, at])
    assert smoothed.calibrated.growth.corrected[-1, at] < forward.calibrated.growth.corrected[-1, at]
    begun, other = ({each.code for each in found.notes} for found in (smoothed, forward))
    assert Code.BUDGET_SMOOTHED_START in begun
    assert Code.BUDGET_SMOOTHED_START not in other
    assert Code.BUDGET_OWN_FIXES not in other


def test_verdicts_by_interval_and_by_one_sensor():
    found = growth(drives.windows())
    factor = found.corrected[-1:] / found.predicted[-1:]

    def verdict(scale: float, **how):
        predicted = np.broadcast_to(found.predicted * factor / scale, found.predicted.shape)
        return {each.component: each for each in verdicts(replace(found, predicted=predicted), **how)}

    assert all(each.explained for each in verdict(1.0).values())
    assert not any(each.cautious for each in verdict(1.0).values())
    assert not any(each.explained for each in verdict(20.0).values())
    assert all(each.cautious for each in verdict(0.05).values())
    # of one draw 2.2 sd are nothing special, 3 are
    assert verdict(2.2, one_sensor=True)["north"].explained
    assert not verdict(3.0, one_sensor=True)["north"].explained
    assert not verdict(2.2, one_sensor=True)["horizontal"].explained


@pytest.mark.parametrize("count", [-1, 1, 2])
def test_too_few_replicas_are_refused(count: int):
    with pytest.raises(ConfigError, match=r"few_replicas"):
        recorded_budget(drives.injected(), drives.SPEC, None, WindowSettings(replicas=count))
