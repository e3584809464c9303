"""The start knows what it was made of: a fix, its lasting error, its clock; and refuses what holds no start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insnav
from insnav.attitude import dcm_from_rph, wrap_pi
from insnav.earth import lla_offset, ned_offset
from insnav.errors.evaluated_run import EvaluatedRun, run_warnings
from insnav.exceptions import InputError
from insnav.filter.error_model import initial_state
from insnav.filter.filter_input import Output
from insnav.filter.gps_noise import CorrelatedNoise
from insnav.filter.navigate import navigate_recording
from insnav.filter.prepare import GivenStart, Start, prepare
from insnav.filter.receiver import DELAY_SD, Delay, LeverArm, Receiver
from insnav.findings import CONTRADICTIONS, Code, of_code
from insnav.result import Result
from insnav.session.simulation import plan_of, profiled
from insnav.simulate import GpsErrors, Truth, corrupt_gps, reference
from insnav.simulate.recording import load_gps
from insnav.types import GpsData, ImuData, Run
from insnav.units import DEG
from tests.filter import drives
from tests.filter.drives import without_velocities
from tests.simulate.profiles import profile

SEEDS = range(60)
ERRORS = GpsErrors((0.3, 0.3, 0.5), (2.0, 2.0, 3.0), 60.0)
LASTING = CorrelatedNoise(4.0 / 4.09, 60.0, np.array([2.0, 2.0, 3.0]))
RTK = GpsErrors((0.02, 0.02, 0.03), velocity_noise=(0.03, 0.03, 0.05))
JUMP = np.array([300.0, 400.0, 0.0])
RECEIVER, OUTPUT = Receiver(LeverArm(drives.LEVER_B)), Output(1.0)


def from_first_fix(seed: int, jump_after: float = np.inf) -> Run:
    """Start from the first fix, whose error lasts for a minute; with the positions moved for good after a while."""
    motion, rng = drives.truth(2), np.random.default_rng([5, seed])
    gps = corrupt_gps(drives.perfect_gps(laps=2), ERRORS, seed)
    gps = replace(gps, lla=np.where(gps.time[:, None] > jump_after, lla_offset(gps.lla, JUMP), gps.lla))
    alignment = replace(drives.begin(drives.MODEL, rng, laps=2).alignment, time=gps.time[0])
    error = alignment.rph - motion.evaluate(np.array([motion.start])).rph[0]
    alignment = replace(alignment, rph=motion.evaluate(gps.time[:1]).rph[0] + error)
    lla = lla_offset(gps.lla[0], -dcm_from_rph(alignment.rph) @ drives.LEVER_B)
    state = initial_state(
        alignment, drives.MODEL, lla, gps.v_n[0], gps.position_sd[0], gps.velocity_sd[0], from_fix=True
    )
    imu = drives.noisy_imu(drives.perfect_imu(laps=2), drives.MODEL, rng)
    return drives.navigate(imu, gps, drives.Begin(state, alignment), drives.MODEL, correlated=LASTING)


def position_nees(run: Run, offset: np.ndarray | float = 0.0) -> np.ndarray:
    """By its expectation, at every fix."""
    error = ned_offset(run.epochs.lla, reference(drives.truth(2), run.epochs.time).lla) - offset
    p = run.epochs.covariance[:, :3, :3]
    return np.einsum("ni,ni->n", error, np.linalg.solve(p, error[..., None])[..., 0]) / 3.0


def test_the_position_of_a_start_is_as_good_as_a_fix_and_no_better():
    nees = np.mean([position_nees(from_first_fix(seed)) for seed in SEEDS], axis=0)
    print("position NEES/3 after 1, 5, 20, 60 fixes:", nees[[0, 4, 19, 59]].round(2))
    # 180 numbers, alike at all epochs: one sd of scatter is 0.1
    assert (nees[:60] > 0.65).all()
    assert (nees[:60] < 1.35).all()


def test_so_is_that_of_a_reset():
    nees = []
    for seed in SEEDS:
        run = from_first_fix(seed, 1030.5)
        later = run.epochs.time > 1041.5
        nees.append(position_nees(run, JUMP)[later])
    mean = np.mean(nees, axis=0)
    print("position NEES/3 after a reset:", mean[[0, 4, 19]].round(2))
    assert (mean[:30] > 0.7).all()
    assert (mean[:30] < 1.3).all()


@pytest.mark.parametrize("velocity", [True, False])
def test_a_clock_offset_is_found_from_a_start_in_motion(velocity):
    ratios = []
    for seed in range(6):
        rng = np.random.default_rng([6, seed])
        gps = corrupt_gps(drives.perfect_gps(laps=3), RTK, seed)
        imu = after(drives.noisy_imu(drives.perfect_imu(laps=3), drives.MODEL, rng), 1019.5)
        gps = replace(gps, time=gps.time + 0.05, v_n=gps.v_n if velocity else gps.v_n * np.nan)
        run = navigate_recording(imu, gps, drives.SPEC, replace(RECEIVER, delay=Delay(sd=DELAY_SD)), output=OUTPUT).run
        assert run.alignment.static is None
        ratios.append((run.gps_delay - 0.05) / run.gps_delay_sd)
        assert run.gps_delay_sd < 0.01
        assert Code.FILTER_RESET not in [event.code for event in run.events]
    print("clock offset, error / sd:", np.round(ratios, 1))
    assert np.abs(ratios).max() < 3.0


def after(imu: ImuData, time: float) -> ImuData:
    late = imu.time > time
    return replace(imu, time=imu.time[late], gyro=imu.gyro[late], accel=imu.accel[late])


# ---- what cannot be navigated


def start_at(time: float) -> Start:
    at = drives.truth(1).evaluate(np.array([1010.0]))
    return Start(time, at.lla[0], at.v_n[0], at.rph[0], np.full(3, 0.1), np.full(3, 0.05), np.full(3, 0.2 * DEG))


def refused(
    imu: ImuData, start: Start | None = None, gps: GpsData | None = None, span: tuple[float, float] | None = None
) -> InputError:
    gps, known = gps or drives.perfect_gps(laps=1), GivenStart(start, span, None if span is None else 0.4)
    with pytest.raises(InputError) as caught:
        navigate_recording(imu, gps, drives.SPEC, RECEIVER, output=OUTPUT, known=known)
    assert caught.value.exit_code == 3
    assert caught.value.why
    assert caught.value.fix
    return caught.value


@pytest.mark.parametrize("rate", [50, 100, 200, 400])
def test_a_start_at_the_beginning_of_the_first_interval_is_inside(rate):
    """The rounding of a mean spacing must not push it out."""
    time = np.arange(1, 20 * rate + 1) / rate
    imu = ImuData(time, np.zeros((time.size, 3)), np.tile([0.0, 0.0, -9.8], (time.size, 1)))
    run = navigate_recording(
        imu, drives.perfect_gps(laps=1), drives.SPEC, RECEIVER, output=OUTPUT, known=GivenStart(start_at(0.0))
    ).run
    assert run.solution.time[0] <= 0.2


@pytest.mark.parametrize("time", [0.0, 999.9, 1075.0, 1e6])
def test_an_initial_state_outside_the_record_is_refused(time):
    imu = drives.perfect_imu(laps=1)
    error = refused(imu, start_at(time))
    assert (error.code, error.values["start_s"]) == ("align.start_outside", time)
    assert error.values["samples_s"] == (imu.time[0], imu.time[-1])


def test_a_record_that_ends_at_its_start_is_refused():
    imu = drives.perfect_imu(laps=1)
    assert refused(imu, start_at(imu.time[-1] - 5e-7)).code == "align.no_sample_after_start"
    gps = drives.perfect_gps(laps=1)
    rows = (getattr(gps, name)[-1:] for name in ("lla", "v_n", "position_sd", "velocity_sd"))
    last = GpsData(imu.time[-1:], *rows)
    error = refused(imu, gps=last, span=(imu.time[-1] - 5.0, imu.time[-1]))
    assert error.code == "align.no_sample_after_start"


def test_an_initial_state_in_a_long_gap_is_refused():
    imu = drives.perfect_imu(laps=1)
    cut = imu.rows((imu.time <= 1030.0) | (imu.time > 1040.05))
    error = refused(cut, start_at(1035.0))
    assert (error.code, error.values["parts"]) == ("align.start_outside", 2)


def test_the_state_starts_at_the_imu_not_at_the_antenna():
    motion = drives.truth()
    ready, _ = prepare(drives.perfect_imu(), drives.perfect_gps(), drives.SPEC, Receiver(LeverArm(drives.LEVER_B)))
    error = ned_offset(ready.initial.lla, reference(motion, np.array([ready.initial.time])).lla[0])
    print(error, ready.alignment.heading_method)
    assert np.linalg.norm(error) < 0.1  # the antenna is 1.2 m away


PARKED = """purpose = "Parked for a quarter of an hour, then bends"
[start]
lat = "48 deg"
lon = "11 deg"
[[segment]]
kind = "static"
duration = "900 s"
[[segment]]
kind = "accelerate"
to = "12 m/s"
[[segment]]
kind = "repeat"
count = 4
segment = [
  { kind = "turn", angle = "90 deg", rate = "15 deg/s" },
  { kind = "cruise", duration = "12 s" },
  { kind = "turn", angle = "-60 deg", rate = "15 deg/s" },
  { kind = "cruise", duration = "12 s" },
]
"""


ARM = np.array([0.3, 0.4, 1.2])


def swinging(time: np.ndarray, size: float = 20.0 * DEG) -> np.ndarray:
    """Angle of a boat at its mooring [rad]."""
    return np.where(time < 800.0, size * np.sin(2.0 * np.pi * time / 800.0), 0.0)


def boarded(time: np.ndarray) -> np.ndarray:
    """Angle of a car that people board: seven times 2 deg to one side and back within two seconds [rad]."""
    after = (time - 60.0) % 120.0
    return np.where((after < 2.0) & (time < 880.0), 2.0 * DEG * np.sin(0.5 * np.pi * after) ** 2, 0.0)


def rocking(time: np.ndarray) -> np.ndarray:
    """Angle of a boat in a swell [rad]."""
    return 8.0 * DEG * np.sin(2.0 * np.pi * time / 47.0) * np.clip((890.0 - time) / 20.0, 0.0, 1.0)


def navigated(
    tmp_path: Path, imu: str, gps: str, angle: Callable[[np.ndarray], np.ndarray] = np.zeros_like, axis: int = 2
) -> tuple[Result[EvaluatedRun], Truth]:
    """Navigate with nothing configured; `angle`: about an axis of the body by time, while parked [rad]."""
    (tmp_path / "parked.toml").write_text(PARKED)
    receiver = replace(load_gps(gps), lever_b=ARM if gps == "rtk" else np.zeros(3), rate=1.0)
    plan = plan_of(profiled(tmp_path / "parked.toml", 3), {"imu": imu, "gps": receiver, "seed": 3})
    measured = plan.measured()
    samples, time = measured.imu, measured.imu.time - measured.imu.time[0]
    angles = angle(time)
    c = dcm_from_rph(angles[:, None] * np.eye(3)[axis])
    turned, level = (np.einsum("nji,nj->ni", c, each) for each in (samples.gyro, samples.accel))
    turned[:, axis] += np.gradient(angles) / (1.0 if samples.sampling == "increment" else np.median(np.diff(time)))
    samples = replace(samples, gyro=turned, accel=level)
    return insnav.load(samples, measured.gps).navigate(output_interval=1.0), plan.truth


def parked(*how: Any) -> tuple[Run, Truth]:
    """The run of `navigated`."""
    result, truth = navigated(*how)
    return result.found.run, truth


def test_fixes_show_no_heading_while_a_vehicle_is_parked(tmp_path):
    """Fixes of what rests do not depend on it, so that it is known less and less."""
    run, motion = parked(tmp_path, "consumer", "single")
    solution, smoothed = run.solution, run.smoothed.solution
    heading_sd = solution.sd[solution.time < 890.0, 8] / DEG
    print(f"heading sd {heading_sd[0]:.1f} deg at the start, least {heading_sd.min():.1f} deg while parked")
    assert heading_sd[0] > 2.0
    assert heading_sd.min() > 0.98 * heading_sd[0]
    truth = motion.evaluate(smoothed.time)
    off = np.abs(ned_offset(smoothed.lla, truth.lla))
    turned = np.abs(wrap_pi(smoothed.rph[:, 2] - truth.rph[:, 2]))
    print(f"smoothed {np.sqrt(np.mean(off**2, axis=0)).round(3)} m, heading {np.rad2deg(turned.max()):.2f} deg at most")
    assert np.mean(off < 3.0 * smoothed.sd[:, :3]) > 0.97
    assert np.mean(turned < 3.0 * smoothed.sd[:, 8]) > 0.97


def test_a_long_rest_says_nothing_of_the_axes_of_the_sensors(tmp_path):
    """Gyros that are askew do nothing to an attitude that is held, and all the same to the smoothed one before a drive.

    Of ten parked drives, in the worst four 34 to 67 % of the attitudes were inside 3 sd.
    """
    run, motion = parked(tmp_path, "automotive", "dgps")
    truth, sd = motion.evaluate(run.smoothed.solution.time), run.smoothed.solution.sd[:, 6:]
    off = np.abs(wrap_pi(run.smoothed.solution.rph - truth.rph))
    shown = [np.rad2deg(np.sqrt(np.mean(each**2, axis=0))).round(3) for each in (off, sd)]
    print(f"attitude off by {shown[0]} deg, sd {shown[1]} deg, inside 3 sd {100 * np.mean(off < 3.0 * sd):.0f} %")
    assert np.mean(off < 3.0 * sd) > 0.99
    assert (run.smoothed.solution.sd[0, 6:8] > 1.3e-3).all()  # misalignments are 2 mrad, as specified


def test_people_who_board_do_not_end_the_rest(tmp_path):
    """Gyros that drift from the first shake on turned the heading by up to 49 deg, inside 3 sd 20 % of the time."""
    run, motion = parked(tmp_path, "consumer", "single", boarded, 0)
    print(f"rest until {run.alignment.left:.1f} s, {np.isnan(run.alignment.sway[:, 0]).sum()} changes unknown")
    for solution in (run.solution, run.smoothed.solution):
        truth = motion.evaluate(solution.time)
        turned = np.abs(wrap_pi(solution.rph[:, 2] - truth.rph[:, 2]))
        print(f"heading off by {turned.max() / DEG:.1f} deg at most, sd {solution.sd[:, 8].max() / DEG:.1f}")
        assert turned.max() < 12.0 * DEG
        assert np.mean(turned < 3.0 * solution.sd[:, 8]) > 0.97
        assert np.mean(np.abs(ned_offset(solution.lla, truth.lla)) < 3.0 * solution.sd[:, :3]) > 0.97


def test_a_boat_that_rocks_before_the_drive_is_never_at_rest(tmp_path):
    """It was, for 8 s by chance: no heading was inside 3 sd, 13 % of the positions were, and that took 74 s."""
    result, motion = navigated(tmp_path, "consumer", "rtk", rocking, 0)
    solution = result.found.run.smoothed.solution
    assert result.found.run.alignment.static is None
    truth = motion.evaluate(solution.time)
    turned = np.abs(wrap_pi(solution.rph[:, 2] - truth.rph[:, 2]))
    print(f"heading off by {np.rad2deg(turned.max()):.1f} deg at most, from {solution.time[0]:.0f} s on")
    assert solution.time[0] < 905.0
    (late,) = of_code(result.findings, Code.ALIGN_LATE)
    assert 900.0 <= late.end < 905.0
    assert np.mean(turned < 3.0 * solution.sd[:, 8]) > 0.97
    assert np.mean(np.abs(ned_offset(solution.lla, truth.lla)) < 3.0 * solution.sd[:, :3]) > 0.97


@pytest.mark.parametrize("by", ["1.5 m/s^2", "0.5 m/s^2"])
def test_a_steady_departure_that_positions_do_not_see_is_no_rest(tmp_path, by):
    """It was, for 1.5 s of 1.5 m/s^2: a bias stepped ten seconds before, and 73 % of the attitudes were inside 3 sd."""
    (tmp_path / "parked.toml").write_text(PARKED.replace('to = "12 m/s"', f'to = "12 m/s"\nacceleration = "{by}"'))
    plan = plan_of(profiled(tmp_path / "parked.toml", 3), {"imu": "automotive", "gps": load_gps("single"), "seed": 3})
    measured = plan.measured()
    gps = replace(measured.gps, v_n=np.full_like(measured.gps.lla, np.nan))
    found = insnav.load(measured.imu, gps).navigate(output_interval=1.0).found
    leaves = float(measured.imu.time[0]) + 900.0
    print(f"at rest until {found.run.alignment.left - leaves:+.2f} s of departure")
    assert -10.0 < found.run.alignment.left - leaves < 1.0
    assert not any(of_code(found.run.events, *CONTRADICTIONS))
    truth = plan.truth.evaluate(found.run.smoothed.solution.time)
    off = np.abs(wrap_pi(found.run.smoothed.solution.rph - truth.rph))
    assert np.mean(off < 3.0 * found.run.smoothed.solution.sd[:, 6:]) > 0.97


@pytest.mark.parametrize("rate", [0.0, 0.05 * DEG])
def test_a_slow_turn_all_through_a_rest_is_warned_of(tmp_path, rate):
    """To the gyros it is a bias, but one that they do not have in the drive."""

    def turning(time: np.ndarray) -> np.ndarray:
        return rate * np.minimum(time - 890.0, 0.0)

    result, _ = navigated(tmp_path, "tactical", "rtk", turning)
    found = [each["angle_rad"] for each in run_warnings(result.found) if each.code is Code.RUN_TURNED_AT_REST]
    print(found)
    assert len(found) == (rate > 0.0)
    assert found == [pytest.approx(44.5 * DEG, abs=1.0 * DEG)] * len(found)


@pytest.mark.parametrize("swings", [0.0, 20.0 * DEG])
def test_nor_a_lever_arm_not_even_of_a_boat_that_swings_at_its_mooring(tmp_path, swings):
    """Gyros that drift turned an arm that is not known: it was 6 m off after half an hour, with an sd of 0.7 m."""
    run, motion = parked(tmp_path, "automotive", "rtk", partial(swinging, size=swings))
    at = run.alignment
    level, heading = np.rad2deg(np.linalg.norm(at.sway, axis=0))
    print(f"level changes by {level:.2f} deg, heading by {heading:.1f} deg; arm off by {run.lever_b - ARM} m")
    assert heading * DEG > 0.4 * swings
    assert (np.abs(run.lever_b - ARM) < 3.0 * run.lever_sd).all()
    for solution in (run.solution, run.smoothed.solution):
        truth = motion.evaluate(solution.time)
        assert np.mean(np.abs(ned_offset(solution.lla, truth.lla)) < 3.0 * solution.sd[:, :3]) > 0.97
        away = solution.time > 905.0
        turned = np.abs(wrap_pi(solution.rph[:, 2] - truth.rph[:, 2]))[away]
        assert np.mean(turned < 3.0 * solution.sd[away, 8]) > 0.97


def test_a_straight_drive_after_a_long_rest_is_no_surer_of_its_tilt_than_right(tmp_path: Path):
    """A bias of the accelerometers, taken for tilt at rest, shows in turns alone, and here there is one of 5 deg.

    With tilts and velocities that did not turn with corrections of the heading, degrees off until the departure, errors
    squared were up to 102 times the variance, and 17 times on average; by consumer IMUs up to 1700 and 250 times.
    """
    line = ("cruise: duration = '70 s'", "arc: angle = '-5 deg', radius = '800 m'", "cruise: duration = '30 s'")
    profile(tmp_path, "static: duration = '290 s'", "accelerate: to = '15 m/s'", *line)
    squares = []
    for seed in range(1, 5):
        drive = insnav.simulate(str(tmp_path / "profile.toml"), imu="automotive", gps="rtk", seed=seed, rate=50.0)
        found = insnav.load(drive.imu.data, without_velocities(drive.gps.data)).navigate().found.run.smoothed.solution
        truth = drive.reference.data
        true = np.column_stack([np.interp(found.time, truth.time, each) for each in np.unwrap(truth.rph, axis=0).T])
        squares.append(((wrap_pi(found.rph - true) / found.sd[:, 6:]) ** 2).mean(axis=0))
    print(np.round(squares, 2))
    assert np.mean(squares) < 3.0
    assert np.max(squares) < 9.0
