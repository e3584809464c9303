"""The filter alone, in this process, on arrays already read."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from insnav.filter.filter_input import Output
from insnav.filter.navigate import Navigated, navigate_recording
from insnav.filter.prepare import GivenStart, Start
from insnav.filter.receiver import DELAY_SD, Delay, LeverArm, Receiver
from insnav.imu import load_imu
from insnav.imu.specification import ImuSpec
from insnav.input import read_gps, read_imu
from insnav.steps.given import read_start
from insnav.types import GpsData, ImuData
from tests.bench.job import Job


@dataclass(frozen=True)
class Recording:
    """Arrays of a job and what the program would assume about them."""

    imu: ImuData
    gps: GpsData
    spec: ImuSpec
    receiver: Receiver
    start: Start
    output: Output

    @cached_property
    def samples(self) -> int:
        """Samples after the given start."""
        return int((self.imu.time > self.start.time + 1e-6).sum())

    def at_interval(self, seconds: float) -> Recording:
        """The same with a row of the solution every so often."""
        return replace(self, output=Output(seconds))

    def first(self, seconds: float) -> Recording:
        """The part up to `seconds` after the given start."""
        end = self.start.time + seconds + 1e-6
        n, m = int(np.searchsorted(self.imu.time, end)), int(np.searchsorted(self.gps.time, end))
        gps = GpsData(
            self.gps.time[:m],
            self.gps.lla[:m],
            self.gps.v_n[:m],
            self.gps.position_sd[:m],
            self.gps.velocity_sd[:m],
        )
        imu = replace(self.imu, time=self.imu.time[:n], gyro=self.imu.gyro[:n], accel=self.imu.accel[:n])
        return replace(self, imu=imu, gps=gps)


def read_recording(job: Job) -> Recording:
    """Read a job with the settings of the program: full rate, GPS delay estimated."""
    receiver = Receiver(LeverArm(np.array(job.start["lever_b_m"])), Delay(sd=DELAY_SD))
    spec = load_imu(str(job.path("imu.toml")))
    imu, gps = read_imu(job.path("imu.csv")).data, read_gps(job.path("gps.csv")).data
    return Recording(imu, gps, spec, receiver, read_start(job.path("start.json")), Output(0.0))


def navigate(recording: Recording, *, given_start: bool) -> tuple[Navigated, float]:
    """Navigate once; the result and its CPU time [s]."""
    begin = time.process_time()
    known = GivenStart(recording.start if given_start else None)
    data = recording.imu, recording.gps, recording.spec, recording.receiver
    done = navigate_recording(*data, known=known, output=recording.output)
    return done, time.process_time() - begin


def best_cpu(recording: Recording, *, given_start: bool, repeat: int) -> tuple[Navigated, float]:
    """Navigate once to compile, then `repeat` times; the result and the smallest CPU time [s]."""
    done, _ = navigate(recording, given_start=given_start)
    return done, min(navigate(recording, given_start=given_start)[1] for _ in range(repeat))
