"""The reference drive of the fault matrix, and what a fault does to it."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insnav.earth import ned_offset
from insnav.filter.navigate import feed
from insnav.filter.navigator import Navigator
from insnav.findings import Code
from insnav.imu.health import inspect
from insnav.simulate import reference
from insnav.simulate.recording import parse_fault
from insnav.types import GpsData, ImuData, Run
from tests.filter import drives

LAPS = 8  # ten minutes
SD = 1.5


@pytest.fixture(scope="session")
def bars() -> dict[str, dict[str, Any]]:
    return tomllib.loads((Path(__file__).parent / "bars.toml").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Drive:
    """A drive, ready for the filter, and the filter's run over it."""

    imu: ImuData
    gps: GpsData
    run: Run

    @property
    def true(self):
        return reference(drives.truth(LAPS), self.run.solution.time)

    @property
    def error(self) -> np.ndarray:
        return ned_offset(self.run.solution.lla, self.true.lla)

    def kinds(self) -> list[Code]:
        return [event.code for event in self.run.events]


@lru_cache(maxsize=60)
def data(seed: int) -> tuple[ImuData, GpsData]:
    rng = np.random.default_rng([91, seed])
    imu = drives.noisy_imu(drives.perfect_imu(laps=LAPS), drives.MODEL, rng)
    perfect = drives.perfect_gps(laps=LAPS)
    gps = drives.noisy_gps(replace(perfect, position_sd=np.full_like(perfect.position_sd, SD)), rng)
    return imu, gps


def navigated(seed: int, *faults: str, **settings: Any) -> Drive:
    """Run over the drive of a seed with faults put into it."""
    imu, gps = data(seed)
    for text in faults:
        imu, gps = parse_fault(text).apply(imu, gps)
    imu, events = inspect(imu)
    start = drives.begin(drives.MODEL, np.random.default_rng([92, seed]), LAPS)
    ready = drives.ready(imu, gps, start, **{"output_interval": 1.0, "smooth": False, **settings})
    navigator = Navigator(ready)
    feed(navigator, imu)
    run = navigator.finish()
    return Drive(imu, gps, replace(run, events=(*events, *run.events)))


@lru_cache(maxsize=60)
def healthy(seed: int) -> Drive:
    return navigated(seed)


def deviation(drive: Drive, seed: int) -> np.ndarray:
    """Horizontal distance from the run without the fault, at every second of both."""
    plain = healthy(seed).run.solution
    n = min(plain.time.shape[0], drive.run.solution.time.shape[0])
    off = ned_offset(drive.run.solution.lla[:n], plain.lla[:n])
    return np.hypot(off[:, 0], off[:, 1])
