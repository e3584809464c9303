"""A recorded drive, read and navigated as the command line does it: no options but the lever arm."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from insnav.alignment import stationary_of
from insnav.filter.gps_noise import with_sd
from insnav.filter.navigate import Navigated, navigate_recording
from insnav.filter.receiver import DELAY_SD, Delay, LeverArm, Receiver
from insnav.imu import ImuSpec
from insnav.input import read_gps, read_imu
from insnav.steps.imu_noise import imu_from_rest
from insnav.strapdown import intervals
from insnav.types import FloatArray, GpsData, ImuData, Innovations
from tests.shared import recorded


def recording(name: str) -> tuple[ImuData, GpsData]:
    """Samples and fixes of a recorded drive; the test is skipped where it is absent."""
    folder = recorded(name)
    return read_imu(folder / "imu.csv.gz").data, read_gps(folder / "gps.csv").data


def imu_model(imu: ImuData, gps: GpsData) -> ImuSpec:
    """IMU model from the static part, 'consumer' where there is none."""
    spec, said = imu_from_rest(imu, stationary_of(intervals(imu), with_sd(gps)[0]))
    print(f"\nIMU model {spec.name}: {said}")
    return spec


def navigated(imu: ImuData, gps: GpsData, spec: ImuSpec, lever_b: Iterable[float] = (0.0, 0.0, 0.0)) -> Navigated:
    """Navigate; the time offset between the clocks is estimated."""
    receiver = Receiver(LeverArm(np.array([*lever_b])), Delay(sd=DELAY_SD))
    done = navigate_recording(imu, gps, spec, receiver)
    _say(done.run.innovations)
    print(f"GPS clock offset {done.run.gps_delay:+.4f} s, sd {done.run.gps_delay_sd:.4f} s")
    return done


def rms(values: FloatArray) -> FloatArray:
    """Root mean square of each column."""
    return np.sqrt(np.mean(values**2, axis=0))


def _say(offered: Innovations) -> None:
    for name, first, used, nis in (
        ("position", 0, offered.used_position, offered.nis_position),
        ("velocity", 3, offered.used_velocity, offered.nis_velocity),
    ):
        known = np.isfinite(nis)
        if known.any():
            size = rms(offered.innovation[used, first : first + 3])
            print(f"{name}: {used.sum()} of {known.sum()} used, innovation RMS {size.round(4)}, ", end="")
            print(f"NIS / 3 {nis[used].mean() / 3.0:.2f}")
