"""Make the sample drive again from ``sample/sample.toml`` and ``sample/imu.toml``, number by number.

python trajectories/make_sample.py [FOLDER]     # without FOLDER: trajectories/sample itself
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from insnav.imu import load_imu
from insnav.output.data_files import write_data
from insnav.simulate import (
    GpsErrors,
    Truth,
    corrupt_gps,
    corrupt_imu,
    gps_from_truth,
    imu_from_truth,
    reference,
    without_fixes,
)
from insnav.simulate.motion.moves import KINDS, Move, State, Vehicle, Vibration, step
from insnav.simulate.motion.profile import Start, commands_of, spacing_of, truth_of
from insnav.simulate.sensor_errors import Seed
from insnav.units import DEG

SAMPLE = Path(__file__).parent / "sample"


@dataclass(frozen=True)
class Segment:
    """One manoeuvre of a car: over `duration` [s] speed [m/s], heading and grade [rad] change together and smoothly."""

    duration: float
    speed: float | None = None  # at the end; None keeps it
    turn: float = 0.0
    grade: float | None = None  # at the end, positive upwards; None keeps it


def drive(
    segments: Sequence[Segment],
    lla: np.ndarray,
    *,
    seed: Seed,
    heading: float = 0.0,
    roll: float = 0.0,
    pitch: float = 0.0,
    start: float = 0.0,
    body: Vehicle = KINDS["car"].body,
) -> Truth:
    """Exact motion of a car from rest; `roll` and `pitch` are those of the IMU in the level car [rad]."""
    moves, state, grade = [], State(0.0, heading), 0.0
    for segment in segments:
        end = State(state.speed if segment.speed is None else segment.speed, state.heading + segment.turn)
        slope = grade if segment.grade is None else segment.grade
        pairs = ((state.speed, end.speed), (state.heading, end.heading), (grade, slope))
        moves.append(Move(segment.duration, state, end, *(partial(change, segment.duration, *pair) for pair in pairs)))
        state, grade = end, slope
    begin, vibration = Start(lla, heading, 0.0, roll, pitch, start), Vibration()
    commands = commands_of(moves, spacing_of(moves, vibration))
    return truth_of(commands, moves, begin, replace(KINDS["car"], body=body), vibration, seed)


def change(duration: float, begin: float, end: float, t: np.ndarray) -> np.ndarray:
    """Smooth change over a duration, at times `t` since its begin."""
    return begin + (end - begin) * step(t / duration)


def read_settings() -> dict[str, Any]:
    """Read ``sample.toml``."""
    return tomllib.loads((SAMPLE / "sample.toml").read_text())


def make_truth(settings: dict[str, Any]) -> Truth:
    """Drive the segments."""
    segments = tuple(
        Segment(
            row["duration_s"],
            speed=row.get("speed_m_s"),
            turn=row.get("turn_deg", 0.0) * DEG,
            grade=float(np.arctan(row["grade_percent"] / 100.0)) if "grade_percent" in row else None,
        )
        for row in settings["segment"]
    )
    roll, pitch, _ = (angle * DEG for angle in settings["vehicle"]["mount_deg"])
    return drive(
        segments,
        np.array([settings["lat_deg"] * DEG, settings["lon_deg"] * DEG, settings["height_m"]]),
        seed=(settings["seed"], 0),
        heading=settings["heading_deg"] * DEG,
        roll=roll,
        pitch=pitch,
        start=settings["start_time_s"],
    )


def times(truth: Truth, rate_hz: int) -> np.ndarray:
    """Evenly spaced times of the whole drive, the start included [s]."""
    return truth.start + np.arange(int(truth.duration * rate_hz) + 1) / rate_hz


def main(folder: Path) -> None:
    """Write ``imu.csv.gz``, ``gps.csv`` and ``ref.csv`` into the folder."""
    settings = read_settings()
    truth = make_truth(settings)
    imu, gps = settings["imu"], settings["gps"]

    perfect = imu_from_truth(truth, times(truth, imu["rate_hz"]), "mean")
    spec = load_imu(str(SAMPLE / "imu.toml"))
    seed = settings["seed"]
    spec = replace(
        spec,
        gyro=replace(spec.gyro, resolution=np.full(3, imu["gyro_step_rad_s"])),
        accel=replace(spec.accel, resolution=np.full(3, imu["accel_step_m_s2"])),
    )
    write_data(folder / "imu.csv.gz", corrupt_imu(perfect, spec, (seed, 1)).imu)

    errors = GpsErrors(
        position_noise=tuple(gps["position_noise_m"]),
        position_drift=tuple(gps["position_drift_m"]),
        correlation_time=gps["correlation_time_s"],
        velocity_noise=tuple(gps["velocity_noise_m_s"]),
    )
    fixes = gps_from_truth(truth, times(truth, gps["rate_hz"])[1:], np.array(settings["lever_arm_m"]))
    begin, end = (truth.start + second for second in gps["outage_s"])
    write_data(folder / "gps.csv", without_fixes(corrupt_gps(fixes, errors, (seed, 2)), begin, end))

    write_data(folder / "ref.csv", reference(truth, times(truth, settings["reference"]["rate_hz"])[1:]))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else SAMPLE)
