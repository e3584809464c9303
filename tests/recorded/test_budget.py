"""Recorded windows of real drives and of a bench: as large as predicted, or with the reason why not."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from insnav.errors.budget.from_windows import RecordedBudget, WindowSettings, recorded_budget
from insnav.errors.outage.free_inertial import WindowReference, reference_from_trajectory, stationary_fixes
from insnav.errors.outage.gnss_outage import COMPONENTS
from insnav.filter.prepare import prepare
from insnav.filter.receiver import DELAY_SD, Delay, LeverArm, Receiver
from insnav.findings import Code, of_code
from insnav.imu import load_imu
from insnav.input import read_imu, read_reference
from insnav.report.budget.windows import CALIBRATED, windows_sentences, windows_warnings
from insnav.types import FloatArray, GpsData, ImuData, Trajectory
from tests.recorded.recording import imu_model, recording
from tests.shared import recorded

AT = {name: i for i, name in enumerate(COMPONENTS)}


def cut(imu: ImuData, length: float) -> ImuData:
    """The first seconds of a recording."""
    keep = imu.time < imu.time[0] + length
    return ImuData(imu.time[keep], imu.gyro[keep], imu.accel[keep], imu.sampling, imu.stamp)


def say(found: RecordedBudget) -> None:
    print("", *windows_sentences(found), *windows_warnings(found), sep="\n")


@lru_cache(maxsize=1)
def bench() -> RecordedBudget:
    folder = recorded("psins_rlg_static")
    imu = read_imu(folder / "imu.csv.gz").data
    lla = read_reference(folder / "ref.csv").data.lla[0]
    spec = load_imu("navigation")
    fixes = stationary_fixes(lla, float(imu.time[0]), float(imu.time[-1]), 0.01, 0.005)
    ready, _ = prepare(imu, fixes, spec, Receiver())
    return recorded_budget(ready, spec, None, WindowSettings(spacing=45.0, uncalibrated=True))


def test_ring_laser_gyros_at_rest_err_by_decimetres_in_a_minute():
    found = bench()
    say(found)
    for part in (found.calibrated, found.uncalibrated):
        assert part is not None
        assert part.windows.count >= 20
        assert (part.windows.motion == "static").all()
        assert part.windows.dropped == {}
        # nothing of a navigation grade moves a metre in a minute, and no error is larger than predicted
        assert part.growth.largest[-1, AT["horizontal"]] < 1.5
        assert all(each.explained for each in part.verdicts), part.verdicts
        assert part.growth.inside[-1, AT["horizontal"]] > 0.95
    # 100 ug alone, levelled by themselves: 1.8 m would be the error of accelerometers that are not
    assert found.uncalibrated is not None
    assert found.uncalibrated.growth.corrected[-1, AT["horizontal"]] < 0.5
    assert (
        found.calibrated.growth.corrected[-1, AT["along"]] != found.calibrated.growth.corrected[-1, AT["along"]]
    )  # no course


@lru_cache(maxsize=1)
def consumer() -> RecordedBudget:
    imu, gps = recording("rtklib_drive_20250708")
    spec = imu_model(imu, gps)
    ready, _ = prepare(imu, gps, spec, Receiver(LeverArm(np.array([0.0, -0.05, 0.0])), Delay(sd=DELAY_SD)))
    return recorded_budget(ready, spec, None, WindowSettings(spacing=20.0, replicas=3))


def test_consumer_mems_in_town_is_worse_than_its_noise_at_rest_says():
    found = consumer()
    say(found)
    part = found.calibrated
    horizontal = part.growth.corrected[:, AT["horizontal"]]
    assert 1.5 < horizontal[0] < 6.0  # after 10 s
    assert 25.0 < horizontal[2] < 80.0  # after 30 s
    assert part.growth.times[-1] == 60.0
    # turns and vibration are in no figure of the noise at rest: the report must say that these do not explain it
    assert 1.2 < part.regression.slope < 2.6
    assert part.regression.low > 1.0
    assert not {each.component: each.explained for each in part.verdicts}["east"]
    assert part.replicas is not None
    assert not part.replicas.agree
    assert [each.subject for each in of_code(windows_warnings(found), Code.BUDGET_OUTSIDE_REPLICAS)] == [CALIBRATED]
    assert not part.diagnosis.steady


@lru_cache(maxsize=1)
def tokyo() -> RecordedBudget:
    imu, gps = recording("ixr_tsukishima_20210412")
    spec = imu_model(imu, gps)
    read = read_reference(recorded("ixr_tsukishima_20210412") / "ref.csv")
    ready, _ = prepare(imu, gps, spec, Receiver(LeverArm(np.array([0.0, 0.3, 0.0])), Delay(sd=DELAY_SD)))
    return recorded_budget(ready, spec, fixed(read.data, read.fix), WindowSettings())


def fixed(data: Trajectory, fix: FloatArray | None) -> WindowReference:
    """Epochs with fixed ambiguities; the velocities are those of the receiver that is navigated with."""
    keep = fix == 1
    unknown = np.full((int(keep.sum()), 3), np.nan)
    rows = Trajectory(data.time[keep], data.lla[keep], unknown, data.rph[keep])
    lever = np.array([0.0, 0.3, 0.0])
    return reference_from_trajectory(rows, "fixed positions", position_sd=0.05, velocity_sd=1.0, lever_b=lever)


def test_tokyo_by_a_fixed_reference_with_gaps():
    found = tokyo()
    say(found)
    part = found.calibrated
    assert part.windows.dropped["reference_gap"] > 10
    assert part.windows.count >= 20
    # a false fix here and there makes an error that is no curve
    assert part.diagnosis.steady
    assert 1 <= part.diagnosis.rough <= 6
    verdict = {each.component: each for each in part.verdicts}
    assert verdict["horizontal"].explained
    for axis in part.diagnosis.axes:
        assert axis.causes[1].explained, axis
        assert axis.causes[2].explained, axis
    straight, turning = part.motions["straight"], part.motions["turning"]
    assert straight is not None
    assert turning is not None
    assert straight.rms[-1, AT["horizontal"]] < turning.rms[-1, AT["horizontal"]]


def test_a_drive_without_its_rest_says_what_was_assumed():
    imu, gps = recording("rtklib_drive_20250708")
    keep = imu.time > imu.time[0] + 60.0
    later = ImuData(imu.time[keep], imu.gyro[keep], imu.accel[keep], imu.sampling, imu.stamp)
    fixes = gps.time > later.time[0]
    some = GpsData(gps.time[fixes], gps.lla[fixes], gps.v_n[fixes], gps.position_sd[fixes], gps.velocity_sd[fixes])
    spec = load_imu("consumer")
    ready, _ = prepare(cut(later, 150.0), some, spec, Receiver(delay=Delay(sd=DELAY_SD)))
    found = recorded_budget(ready, spec, None, WindowSettings(length=30.0, spacing=10.0))
    assert {Code.BUDGET_NO_STATIONARY_WINDOW, Code.BUDGET_OWN_FIXES} <= {note.code for note in found.notes}
    assert found.calibrated.windows.count >= 3


@pytest.mark.parametrize("which", ["calibrated", "uncalibrated"])
def test_the_bench_shows_no_velocity_nor_drift(which: str):
    part = getattr(bench(), which)
    assert part.diagnosis.steady
    for axis in part.diagnosis.axes:
        assert all(cause.explained for cause in axis.causes), axis
    assert not part.sensors.level_observable
