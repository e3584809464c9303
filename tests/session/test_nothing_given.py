"""The sample drive with no option at all: noise, lever arm and delay are estimated, and the sd is true."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import insnav
from insnav.attitude import wrap_pi
from insnav.errors.budget.from_windows import WindowSettings
from insnav.errors.evaluated_run import EvaluatedRun
from insnav.exceptions import AlignmentError, InputError
from insnav.findings import CORRELATED_POSITIONS, Code, Finding, of_code
from insnav.imu import load_imu
from insnav.messages import sentence
from insnav.result import Result
from insnav.simulate import GpsErrors
from insnav.units import DEG
from tests.filter.drives import without_velocities
from tests.simulate.motions import Segment, drive, measured

SAMPLE = Path(__file__).parents[2] / "trajectories" / "sample"
LEVER = np.array([0.8, -0.3, -1.2])


def navigated(**inputs) -> Result[EvaluatedRun]:
    files = SAMPLE / "imu.csv.gz", SAMPLE / "gps.csv", SAMPLE / "ref.csv"
    return insnav.load(*files, **inputs).navigate()


@pytest.fixture(scope="module")
def result() -> Result[EvaluatedRun]:
    return navigated()


def inside(errors) -> float:
    return float(np.mean(np.abs(errors.position) <= 3.0 * errors.sd[:, :3]))


def test_position_errors_are_inside_three_sd(result):
    assert inside(result.found.errors) > 0.97
    assert inside(result.found.smoothed_errors) > 0.97


def test_with_all_given_but_what_lasts_of_the_errors_of_fixes_that_is_found():
    """Of the variance of the fixes 7 % lasts for 30 s: taken for white, smoothed positions are 93.5 % inside."""
    given = {"imu": str(SAMPLE / "imu.toml"), "lever_arm": LEVER, "gps_delay": 0.0}
    found, white = navigated(**given), navigated(**given, noise="model")
    assert inside(found.found.smoothed_errors) > 0.99 > 0.95 > inside(white.found.smoothed_errors)
    horizontal = [np.sqrt(np.mean(each.found.errors.position[:, :2] ** 2)) for each in (found, white)]
    assert horizontal[0] < 1.02 * horizontal[1]
    (correlated,) = of_code(found.findings, *CORRELATED_POSITIONS)
    assert 0.5 < correlated["share"] / 0.07 < 2.0  # the odds are known to a factor of two to three


@pytest.mark.parametrize(
    ("model", "factor", "code"),
    [
        ("automotive", 1.0, None),
        ("navigation", 1.0, Code.GIVEN_IMU_MODEL),
        ("automotive", 0.3, Code.GIVEN_NOISE),
    ],
)
def test_noise_that_is_given_too_small_is_said(model, factor, code):
    """A specification of too good an IMU, or reported sds of a third of the true ones, gives a finding.

    Earlier versions ended with an error of 297 m and with all fixes rejected, and did not report the noise. Noise and
    bias of the gyros at rest contradict navigation grade.
    """
    drive = insnav.simulate("figure_eight", imu="automotive", gps="single", seed=11)
    fixes = drive.gps.data
    fixes = replace(fixes, position_sd=factor * fixes.position_sd, velocity_sd=factor * fixes.velocity_sd)
    result = insnav.load(drive.imu.data, fixes, imu=model).navigate()
    warned = [each for each in result.findings if each.code in (Code.GIVEN_NOISE, Code.GIVEN_IMU_MODEL)]
    told = {each.code for each in warned}
    assert told == ({code} if code else set()) or told == {code, Code.GIVEN_NOISE}  # the innovations, too
    for rest in of_code(warned, Code.GIVEN_IMU_MODEL):
        assert rest["noise_rad_sqrt_s"] == pytest.approx(load_imu("automotive").gyro.random_walk.min(), rel=0.2)
    noise = list(of_code(warned, Code.GIVEN_NOISE))
    assert all(each["mean_square"] > each["limit_mean_square"] for each in noise)
    assert {sentence(each) for each in noise} <= set(result.page().warnings)


def test_lever_arm_and_delay_are_found(result):
    run = result.found.run
    assert (np.abs(run.lever_b - LEVER) <= 3.0 * run.lever_sd).all()
    np.testing.assert_allclose(run.lever_b[:2], LEVER[:2], atol=0.2)
    assert (run.lever_sd < 0.2).all()
    assert run.gps_delay == pytest.approx(0.0, abs=0.010)


def test_the_imu_as_found_can_be_given(result, tmp_path):
    folder = result.save(tmp_path / "run", figures="none")
    spec = load_imu(str(folder / "imu.toml"))
    np.testing.assert_allclose(spec.gyro.bias_instability, result.imu_model[0].gyro.bias_instability)
    again = navigated(imu=spec)
    assert again.found.noise is None  # a model that is given is taken as it is
    assert result.found.noise is not None
    assert navigated(imu=spec, noise="estimate").found.noise is not None


def test_a_budget_uses_the_noise_that_was_found():
    drive = insnav.load(SAMPLE / "imu.csv.gz", SAMPLE / "gps.csv", SAMPLE / "ref.csv")
    found = drive.budget(windows=WindowSettings(replicas=0))
    assert (
        found.imu_model[0].name == "automotive, as found"
    )  # as it is; its noise at rest is that of consumer grade, too
    assert found.imu_model[1] == Finding.of(Code.IMU_MODEL_ESTIMATED, prior="automotive", nearest="consumer")
    assert not any(of_code(found.findings, Code.IMU_MODEL_FROM_REST))  # which says that consumer is used
    assert any(of_code(found.findings, Code.ESTIMATE_NOISE))
    horizontal = found.found.windows.calibrated.verdicts[-1]
    assert horizontal.low < horizontal.predicted < horizontal.high
    assert 0.8 < horizontal.recorded / horizontal.predicted < 1.25  # with the preset 0.5


def test_a_lever_arm_of_zero_is_zero():
    drive = insnav.load(SAMPLE / "imu.csv.gz", SAMPLE / "gps.csv", lever_arm=(0.0, 0.0, 0.0))
    assert drive.model.receiver.lever_arm.sd == 0.0
    assert insnav.load(SAMPLE / "imu.csv.gz", SAMPLE / "gps.csv").model.receiver.lever_arm.sd == 1.0


def test_a_drive_by_another_imu_is_named(tmp_path):
    (tmp_path / "other").mkdir()
    samples = pd.read_csv(SAMPLE / "imu.csv.gz")
    gyros = [name for name in samples if name.startswith("gyro")]
    rate = 1.0 / np.median(np.diff(samples.time_s))
    walk = 5.0 * DEG / 60.0  # 5 deg/sqrt(h): twenty times that of the sample
    samples[gyros] += walk * np.sqrt(rate) * np.random.default_rng(1).normal(size=(len(samples), 3))
    samples.to_csv(tmp_path / "other" / "imu.csv", index=False)
    own, other = (SAMPLE / "imu.csv.gz", SAMPLE / "gps.csv"), (tmp_path / "other" / "imu.csv", SAMPLE / "gps.csv")
    warnings = insnav.tune(own, own, other, lever_arm=LEVER).findings
    assert {each.code for each in warnings} == {Code.TUNE_DRIVES_DIFFER}
    (walk,) = (each for each in warnings if each.subject == "gyro.random_walk")
    assert (walk["low"], walk["high"]) == ("sample/imu.csv.gz", "other/imu.csv")
    assert walk["ratio"] > 5.0


def test_drives_of_one_imu_are_tuned_together(tmp_path):
    for name in ("monday", "tuesday"):
        (tmp_path / name).mkdir()
        for file in ("imu.csv.gz", "gps.csv"):
            (tmp_path / name / file).symlink_to(SAMPLE / file)
    both = insnav.tune(tmp_path, lever_arm=LEVER)
    one = insnav.tune(tmp_path / "monday" / "imu.csv.gz", gps=tmp_path / "monday" / "gps.csv", lever_arm=LEVER)
    assert (both.found.drives, both.findings) == (2, ())
    widths = [
        {figure.key: np.log(figure.high / figure.low) for figure in result.found.figures if figure.observable}
        for result in (both, one)
    ]
    assert widths[0]["gyro.bias_instability"] < 0.8 * widths[1]["gyro.bias_instability"]
    with pytest.raises(InputError, match=r"tune.no_fixes"):
        insnav.tune(SAMPLE / "imu.csv.gz")


@pytest.mark.parametrize(("profile", "seed"), [("city", 3), ("round_trip", 1)])
def test_with_an_imu_given_standard_deviations_that_were_not_are_found(profile, seed):
    """Between houses fixes err by more than is assumed of their type: 85 and 92 % were inside."""
    made = insnav.simulate(profile, imu="automotive", gps="urban", seed=seed)
    nothing = np.full_like(made.gps.data.lla, np.nan)
    silent = replace(made.gps.data, position_sd=nothing, velocity_sd=nothing)
    drive = insnav.load(made.imu.data, silent, made.reference.data, imu="automotive")
    done = drive.navigate()
    assert inside(done.found.smoothed_errors) > 0.97
    assert any(of_code(done.findings, Code.ESTIMATE_POSITION_SD))


@pytest.mark.parametrize("kept", [("v_n",), (), ("v_n", "fix")])
def test_without_reported_standard_deviations_errors_are_as_stated(kept):
    """Positions alone, with velocities, or with the type of fix: scatter of successive fixes is not their error."""
    known = insnav.load(SAMPLE / "imu.csv.gz", SAMPLE / "gps.csv", SAMPLE / "ref.csv")
    gps = known.gps.data
    nothing = np.full_like(gps.position_sd, np.nan)
    fix = np.full(gps.time.size, 5) if "fix" in kept else np.ones(gps.time.size, dtype=int)  # ones: a flag, no type
    silent = replace(gps, position_sd=nothing, fix=fix, v_n=gps.v_n if "v_n" in kept else nothing)
    drive = insnav.load(known.imu.data, silent, known.reference.data)
    found = drive.navigate().found
    assert any(of_code(drive.notes, Code.GPS_POSITION_SD_FIX_TYPE))
    assert found.noise is not None
    # positions alone do not tell how high above the IMU the antenna is: what is as good as stated is the antenna there
    unseen = np.zeros(3) if "v_n" in kept else (found.run.lever_b - LEVER) * [0.0, 0.0, 1.0]
    for errors in (found.errors, found.smoothed_errors):
        assert inside(errors) > 0.97
        assert (np.sqrt(np.mean((errors.position + unseen) ** 2, axis=0)) < [1.0, 1.0, 1.2]).all()
    assert (np.abs(found.run.lever_b - LEVER) <= 3.0 * found.run.lever_sd).all()
    assert abs(found.run.gps_delay) <= 3.0 * found.run.gps_delay_sd


@pytest.mark.parametrize(("grade", "velocities"), [("automotive", True), ("automotive", False), ("consumer", True)])
def test_a_long_straight_road_makes_neither_tilt_nor_heading_too_sure(grade, velocities):
    """What it does not show, biases across, was taken for as small as what it shows: 1 to 44 % of rolls inside 3 sd.

    Gyros that drift less than their grade were no surer of the bias that the rest before had shown: heading 6 deg off.
    """
    spec = load_imu(grade)
    spec = replace(spec, gyro=replace(spec.gyro, bias_instability=0.1 * spec.gyro.bias_instability))
    road = [Segment(30.0), Segment(20.0, speed=30.0), Segment(500.0)]
    truth = drive(road, np.array([0.8, 0.2, 400.0]), seed=1, heading=2.0)
    imu, gps = measured(truth, 50.0, spec, GpsErrors((1.0, 1.0, 2.0), velocity_noise=(0.1, 0.1, 0.2)), 1)
    found = insnav.load(imu, gps if velocities else without_velocities(gps)).navigate()
    at = found.found.run.smoothed.solution
    off = wrap_pi(at.rph - truth.evaluate(at.time).rph)
    assert np.mean(np.abs(off) < 3.0 * at.sd[:, 6:]) > 0.97
    assert np.sqrt(np.mean(off[:, 2] ** 2)) < 2.5 * DEG


@pytest.mark.parametrize("given", [True, False])
def test_fixes_that_are_all_too_poor_are_refused(given: bool):
    made = insnav.simulate("city", imu="automotive", seed=51)
    poor = replace(made.gps.data, position_sd=np.full_like(made.gps.data.lla, 1e6))
    with pytest.raises(AlignmentError):
        insnav.load(made.imu.data, poor, **({"imu": "automotive"} if given else {})).navigate()
