"""Logs of further sensors: found useful where they are, refused or rejected where they are wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insnav.attitude import dcm_from_rph, wrap_pi
from insnav.earth import ned_offset
from insnav.exceptions import ConfigError, InputError
from insnav.filter.error_model import error_model
from insnav.filter.measurements import kinds, measurements_from_drive
from insnav.filter.measurements.measurement import FirstPass, clock_offset
from insnav.findings import Code, Finding, of_code
from insnav.imu.specification import ImuSpec
from insnav.input.readers.rows import read_sensor_log
from insnav.session.drive import load
from insnav.simulate import reference, without_fixes
from insnav.types import SensorLog
from insnav.units import DEG, DEG_PER_H
from tests.filter import drives

SCALE, EPOCH = 1.04, 86400.37  # of the speedometer: what it shows is too large, and its clock started elsewhere
FIELD_N = np.array([0.22, 0.012, 0.42])  # magnetic field, Gauss: declination 3.1 deg
DECLINATION = np.degrees(np.arctan2(FIELD_N[1], FIELD_N[0]))
HARD_IRON = np.array([0.05, -0.08, 0.1])
MOTION = drives.truth(laps=0)
POOR = replace(drives.SPEC, gyro=replace(drives.SPEC.gyro, bias_instability=700 * DEG_PER_H * np.ones(3)))
LENGTH = 60.0  # of the outage [s]


def rng_of(seed: int) -> np.random.Generator:
    return np.random.default_rng([77, seed])


def speed_log(seed: int = 0, rate: float = 5.0) -> SensorLog:
    time = MOTION.start - 20.0 + np.arange(0.0, MOTION.duration + 10.0, 1.0 / rate)
    inside = np.clip(time, MOTION.start, MOTION.start + MOTION.duration - 0.1)
    speed = np.linalg.norm(reference(MOTION, inside).v_n, axis=1)
    noisy = np.maximum(SCALE * speed + 0.05 * rng_of(seed).standard_normal(time.shape), 0.0)
    return SensorLog("speedometer", time + EPOCH, {"speed": noisy})


def field_log(seed: int = 0) -> SensorLog:
    time = MOTION.start + np.arange(0.0, MOTION.duration - 0.1, 0.1)
    field = np.einsum("nji,j->ni", dcm_from_rph(reference(MOTION, time).rph), FIELD_N) + HARD_IRON
    field += 0.005 * rng_of(seed).standard_normal(field.shape)
    return SensorLog("magnetometer", time, dict(zip(("mag_x", "mag_y", "mag_z"), field.T, strict=True)))


def passes(seed: int, *logs: SensorLog, spec: ImuSpec = drives.SPEC):
    """First pass and second pass with a GPS outage, and the row at its end."""
    begin = MOTION.start + 150.0
    rng, model = rng_of(seed), error_model(spec, 21)
    imu = drives.noisy_imu(drives.perfect_imu(laps=0), model, rng)
    gps = drives.noisy_gps(without_fixes(drives.perfect_gps(laps=0), begin, begin + LENGTH), rng)
    start = drives.begin(model, rng, laps=0)
    first = drives.navigate(imu, gps, start, model, output_interval=0.1)
    found, notes = measurements_from_drive(
        FirstPass(first.smoothed.solution, imu, gps, spec, {log.name: log for log in logs})
    )
    run = drives.navigate(imu, gps, start, model, output_interval=0.1, aiding=found)
    row = int(np.searchsorted(run.solution.time, begin + LENGTH - 1e-3))
    return run, notes, row


def error(run, row: int) -> float:
    true = reference(MOTION, run.solution.time[row : row + 1]).lla[0]
    return float(np.hypot(*ned_offset(run.solution.lla[row], true)[:2]))


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def note_of(notes: tuple[Finding, ...], *codes: Code) -> Finding:
    return next(of_code(notes, *codes))


def lag_of(notes: tuple[Finding, ...]) -> float:
    return note_of(notes, Code.ODOMETER_USED)["lag_s"]


def test_kinds_are_found_in_their_order():
    names = [kind.name for kind in kinds()]
    order = ["height", "zupt", "odometer", "speedometer", "magnetometer", "nhc"]
    assert [name for name in names if name in order] == order


def test_a_speedometer_of_another_clock_and_scale_halves_the_drift_in_an_outage():
    without, with_log, inside = [], [], []
    for seed in range(6):
        run, _, row = passes(seed)
        without.append(error(run, row))
        run, notes, row = passes(seed, speed_log(seed))
        with_log.append(error(run, row))
        inside.append(error(run, row) < 3.0 * np.hypot(*run.solution.sd[row, :2]))
        assert lag_of(notes) == pytest.approx(EPOCH, abs=0.03)
        assert note_of(notes, Code.ODOMETER_USED)["scale"] == pytest.approx(1.0 / SCALE, abs=0.002)
        assert {use.name: use.rejected for use in run.aiding}["speedometer"] < 20
    print("after 60 s:", np.round(without, 2), "with speedometer", np.round(with_log, 2))
    assert rms(with_log) < 0.5 * rms(without)
    assert np.mean(inside) > 0.8


def test_a_speed_log_of_another_drive_is_refused():
    log = speed_log()
    other = replace(log, values={"speed": np.roll(log.values["speed"][::-1], 300)})
    run, notes, _ = passes(0, other)
    assert note_of(notes, Code.SPEEDOMETER_CLOCK)
    assert "speedometer" not in {use.name for use in run.aiding}


def test_a_speed_log_that_contradicts_a_part_of_the_drive_is_refused():
    log = speed_log()
    late = log.time > float(np.quantile(log.time, 0.6))
    wrong = replace(log, values={**log.values, "speed": np.where(late, 0.7, 1.0) * log.values["speed"]})
    _, notes, _ = passes(0, wrong)
    note = note_of(notes, Code.SPEEDOMETER_OUTLIERS)
    assert note["share"] > note["limit_share"]


def test_a_speed_log_without_numbers_is_refused():
    log = speed_log()
    _, notes, _ = passes(0, replace(log, values={**log.values, "speed": np.full_like(log.time, np.nan)}))
    note = note_of(notes, Code.ODOMETER_FEW)
    assert (note.subject, note["count"]) == ("speedometer", 0)


def test_a_speedometer_that_sticks_in_the_outage_is_rejected():
    log = speed_log()
    stuck = log.values["speed"].copy()
    late = (log.time - EPOCH > MOTION.start + 150.0) & (log.time - EPOCH < MOTION.start + 165.0)
    stuck[late] = 25.0
    without, _, row = passes(0)
    run, notes, row = passes(0, replace(log, values={"speed": stuck}))
    assert {use.name: use.rejected for use in run.aiding}["speedometer"] > 30
    assert any(event.subject == "speedometer" for event in of_code(run.events, Code.GATE_AIDING))
    assert error(run, row) < 2.0 * error(without, row) + 2.0
    assert lag_of(notes) == pytest.approx(EPOCH, abs=0.05)


def test_reported_standard_deviations_are_believed_where_they_are_larger():
    log = speed_log()
    modest = replace(log, values={**log.values, "sd": np.full(log.time.shape, 2.0)})
    solution = reference(MOTION, MOTION.start + np.arange(0.1, MOTION.duration - 0.1, 0.1))
    sds = []
    for each in (log, modest):
        first = FirstPass(
            solution, drives.perfect_imu(laps=0), drives.perfect_gps(laps=0), drives.SPEC, {each.name: each}
        )
        (found,) = [kind for kind in measurements_from_drive(first)[0] if kind.name == "speedometer"]
        sds.append(float(found.sd[0]))
    assert sds[0] < 0.3
    assert sds[1] == 2.0


def test_clocks_are_matched_only_where_the_motion_is_unmistakable():
    time = np.arange(0.0, 300.0, 0.1)
    motion = 10.0 + 5.0 * np.sin(time / 7.0) + 4.0 * np.sin(time / 23.0) + 3.0 * np.sin(time / 61.0)
    assert clock_offset(time, motion, time + 12345.6, 3.6 * motion) == pytest.approx(12345.6, abs=0.2)
    periodic = 10.0 + 5.0 * np.sin(time / 7.0)
    assert clock_offset(time, periodic, time + 12345.6, periodic) is None
    assert clock_offset(time, periodic, time + 0.6, periodic) == pytest.approx(0.6, abs=0.2)
    assert clock_offset(time, np.full_like(time, 20.0), time, np.full_like(time, 20.0)) is None
    assert clock_offset(time[:100], motion[:100], time, motion) is None


def test_a_magnetometer_holds_the_heading_of_poor_gyros_in_an_outage():
    without, with_log = [], []
    for seed in range(4):
        for kept, logs in ((without, ()), (with_log, (field_log(seed),))):
            run, notes, row = passes(seed, *logs, spec=POOR)
            true = reference(MOTION, run.solution.time[row : row + 1]).rph[0, 2]
            kept.append(float(wrap_pi(run.solution.rph[row, 2] - true)) / DEG)
        declination = note_of(notes, Code.MAGNETOMETER_USED)["declination_rad"]
        assert declination == pytest.approx(DECLINATION * DEG, abs=1.0 * DEG)
    print("heading error after 60 s [deg]:", np.round(without, 2), "with magnetometer", np.round(with_log, 2))
    assert rms(with_log) < 0.5 * rms(without)


def test_a_magnetometer_beside_moving_steel_is_refused():
    log = field_log()
    steel = {key: value + 0.3 * np.sin(log.time / 11.0 + i) for i, (key, value) in enumerate(log.values.items())}
    run, notes, _ = passes(0, replace(log, values=steel))
    note = note_of(notes, Code.MAGNETOMETER_POOR)
    assert note["rms_rad"] > note["limit_rad"]
    assert "magnetometer" not in {use.name for use in run.aiding}


def test_a_heading_column_will_do(tmp_path: Path):
    time = MOTION.start + np.arange(0.0, MOTION.duration - 0.1, 0.2)
    shown = np.degrees(reference(MOTION, time).rph[:, 2]) - 4.0 + rng_of(3).standard_normal(time.shape)
    path = tmp_path / "compass.csv"
    rows = [f"{t:.2f},{h % 360.0:.3f}" for t, h in zip(time, shown, strict=True)]
    path.write_text("\n".join(["time_s,heading_deg", *rows]) + "\n")
    _, notes, _ = passes(1, read_sensor_log(path, "magnetometer").data)
    note = note_of(notes, Code.MAGNETOMETER_USED)
    assert note["declination_rad"] == pytest.approx(4.0 * DEG, abs=0.5 * DEG)
    assert np.isnan(note["iron_share"])


def test_speed_files_are_read_with_their_units(tmp_path: Path):
    path = tmp_path / "speed.csv"
    path.write_text("time [ms],speed [km/h]\n0,36\n100,\n200,72\n300,36\n")
    reading = read_sensor_log(path, "speedometer")
    np.testing.assert_allclose(reading.data.time, [0.0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(reading.data.values["speed"], [10.0, np.nan, 20.0, 10.0])
    path.write_text("time_s,rpm\n0,1\n1,2\n2,3\n")
    with pytest.raises(InputError, match="speed_m_s"):
        read_sensor_log(path, "speedometer")


def test_a_drive_takes_logs_and_says_what_came_of_them(tmp_path: Path):
    path = tmp_path / "speed.csv"
    log = speed_log()
    rows = [f"{t:.2f},{3.6 * v:.4f}" for t, v in zip(log.time, log.values["speed"], strict=True)]
    path.write_text("\n".join(["time_s,speed_km_h", *rows]) + "\n")
    rng = rng_of(0)
    imu = drives.noisy_imu(drives.perfect_imu(laps=0), drives.MODEL, rng)
    gps = drives.noisy_gps(drives.perfect_gps(laps=0), rng)
    drive = load(imu, gps=gps, imu=drives.SPEC, lever_arm=drives.LEVER_B, logs={"speedometer": path})
    done = drive.navigate()
    assert "speedometer" in {use.name for use in done.found.run.aiding}
    assert lag_of(done.findings) == pytest.approx(EPOCH, abs=0.03)
    assert done.inputs["speedometer"].n_used == log.time.size
    with pytest.raises(ConfigError, match=r"input.unknown_sensor"):
        load(imu, gps=gps, logs={"lidar": path})
