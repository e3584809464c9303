"""Make the sample drive again from ``sample/sample.toml`` and ``sample/imu.toml``, number by number.

python trajectories/make_sample.py [FOLDER]     # without FOLDER: trajectories/sample itself
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from insnav.imu import load_imu
from insnav.output.data_files import write_gps, write_imu, write_reference
from insnav.simulate import (
    GpsErrors,
    Profile,
    Segment,
    Truth,
    Vehicle,
    corrupt_gps,
    corrupt_imu,
    drive,
    gps_from_truth,
    imu_from_truth,
    reference,
    without_fixes,
)
from insnav.units import DEG

SAMPLE = Path(__file__).parent / "sample"


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
    roll, pitch, heading = (angle * DEG for angle in settings["vehicle"]["mount_deg"])
    return drive(
        Profile(segments, heading=settings["heading_deg"] * DEG),
        np.array([settings["lat_deg"] * DEG, settings["lon_deg"] * DEG, settings["height_m"]]),
        Vehicle(mount=(roll, pitch, heading)),
        seed=(settings["seed"], 0),
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
    steps = {"gyro_step": imu["gyro_step_rad_s"], "accel_step": imu["accel_step_m_s2"]}
    write_imu(folder / "imu.csv.gz", corrupt_imu(perfect, spec, (seed, 1), **steps).imu)

    errors = GpsErrors(
        position_noise=tuple(gps["position_noise_m"]),
        position_drift=tuple(gps["position_drift_m"]),
        correlation_time=gps["correlation_time_s"],
        velocity_noise=tuple(gps["velocity_noise_m_s"]),
    )
    fixes = gps_from_truth(truth, times(truth, gps["rate_hz"])[1:], np.array(settings["lever_arm_m"]))
    begin, end = (truth.start + second for second in gps["outage_s"])
    write_gps(folder / "gps.csv", without_fixes(corrupt_gps(fixes, errors, (seed, 2)), begin, end))

    write_reference(folder / "ref.csv", reference(truth, times(truth, settings["reference"]["rate_hz"])[1:]))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else SAMPLE)
