"""A drive with turns, hills and stops, and errors drawn exactly as the filter believes them to be."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.signal import lfilter

from insnav.attitude import quat_conjugate, quat_from_rotvec, quat_from_rph, quat_multiply, rph_from_quat
from insnav.earth import lla_offset
from insnav.filter.error_model import ErrorModel, InitialState, Part, error_model, initial_state
from insnav.filter.filter_input import FilterInput
from insnav.filter.gates import Gates
from insnav.filter.navigator import Navigator
from insnav.findings import Code
from insnav.imu.specification import ImuSpec, SensorSpec
from insnav.simulate import Truth, gps_from_truth, imu_from_truth
from insnav.types import Alignment, FloatArray, GpsData, ImuData, Run
from insnav.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, M_S_PER_SQRT_H, PPM, UG
from tests.simulate.motions import Segment, drive

PLACE = np.array([45.0 * DEG, 7.0 * DEG, 240.0])
LEVER_B = np.array([0.4, -0.3, -1.1])
POSITION_SD, VELOCITY_SD = np.array([0.5, 0.5, 1.0]), np.array([0.1, 0.1, 0.15])
START_SD = np.array([0.5, 0.5, 1.0, 0.1, 0.1, 0.1, 0.3 * DEG, 0.3 * DEG, 1.0 * DEG])
THREE = np.ones(3)
SPEC = ImuSpec(
    "of the filter's own kind",
    SensorSpec(
        bias_instability=30 * DEG_PER_H * THREE,
        correlation_time=600.0,
        random_walk=0.2 * DEG_PER_SQRT_H * THREE,
        scale_factor=800 * PPM * THREE,
    ),
    SensorSpec(
        bias_instability=500 * UG * THREE,
        correlation_time=600.0,
        random_walk=0.1 * M_S_PER_SQRT_H * THREE,
        scale_factor=500 * PPM * THREE,
    ),
)


GIVEN = Code.ALIGN_LEVEL_GIVEN, Code.ALIGN_HEADING_GIVEN


@lru_cache(maxsize=4)
def truth(laps: int = 4) -> Truth:
    """Seventy-five seconds a lap, with a stop in each; no laps: as long as four, but no part of it comes again."""
    lap = (
        Segment(8.0, speed=14.0),
        Segment(7.0, turn=80 * DEG),
        Segment(10.0, speed=19.0, grade=0.04),
        Segment(8.0, turn=-130 * DEG, grade=0.0),
        Segment(9.0, speed=8.0, turn=40 * DEG),
        Segment(9.0, turn=170 * DEG, grade=-0.03),
        Segment(8.0, speed=15.0, grade=0.0),
        Segment(8.0, speed=0.0),
        Segment(8.0),
    )
    varied = (
        Segment(14.0, speed=17.0),
        Segment(7.0, turn=80 * DEG),
        Segment(21.0, speed=9.0, grade=0.03),
        Segment(8.0, turn=-130 * DEG, grade=0.0),
        Segment(16.0, speed=0.0),
        Segment(11.0),
        Segment(25.0, speed=24.0, grade=-0.02),
        Segment(12.0, turn=100 * DEG, grade=0.0),
        Segment(9.0, speed=12.0),
        Segment(18.0, turn=-170 * DEG),
        Segment(31.0, speed=20.0),
        Segment(6.0, speed=5.0),
        Segment(10.0, turn=90 * DEG),
        Segment(23.0, speed=16.0),
        Segment(13.0, turn=-60 * DEG, speed=11.0),
        Segment(27.0, speed=19.0),
        Segment(15.0, speed=0.0),
        Segment(7.0),
        Segment(28.0, speed=14.0),
    )
    return drive(lap * laps or varied, PLACE, seed=11, heading=0.4, roll=0.02, pitch=-0.03, start=1000.0)


@lru_cache(maxsize=8)
def perfect_imu(rate: float = 50.0, sampling: str = "increment", laps: int = 4) -> ImuData:
    motion = truth(laps)
    return imu_from_truth(motion, motion.start + np.arange(round(motion.duration * rate) + 1) / rate, sampling)


@lru_cache(maxsize=4)
def perfect_gps(interval: float = 1.0, laps: int = 4) -> GpsData:
    motion = truth(laps)
    time = motion.start + np.arange(interval, motion.duration - 0.2, interval)
    n = time.size
    gps = gps_from_truth(motion, time, LEVER_B)
    return replace(gps, position_sd=np.tile(POSITION_SD, (n, 1)), velocity_sd=np.tile(VELOCITY_SD, (n, 1)))


def noisy_gps(gps: GpsData, rng: np.random.Generator) -> GpsData:
    """White noise of the size the fixes claim."""
    shape = gps.lla.shape
    return replace(
        gps,
        lla=lla_offset(gps.lla, rng.standard_normal(shape) * gps.position_sd),
        v_n=gps.v_n + rng.standard_normal(shape) * gps.velocity_sd,
    )


def noisy_imu(imu: ImuData, model: ErrorModel, rng: np.random.Generator) -> ImuData:
    """Increments with the twelve Gauss-Markov errors and the white noise of `model`: (1 + s) x + b dt + w."""
    n, dt = imu.time.size, float(np.median(np.diff(imu.time)))
    keep = np.exp(-model.decay * dt)
    drive_sd = np.sqrt(model.noise[6:18] * (1 - keep**2) / np.where(model.decay > 0, 2 * model.decay, 1.0))
    steps = rng.standard_normal((n, 12)) * drive_sd
    steps[0] = rng.standard_normal(12) * model.sd
    error = np.column_stack([lfilter([1.0], [1.0, -a], steps[:, i]) for i, a in enumerate(keep)])
    white = rng.standard_normal((n, 6)) * np.sqrt(model.noise[:6] * dt)
    gyro = imu.gyro * (1 + error[:, 6:9]) + error[:, :3] * dt + white[:, :3]
    accel = imu.accel * (1 + error[:, 9:]) + error[:, 3:6] * dt + white[:, 3:]
    return replace(imu, gyro=gyro, accel=accel)


@dataclass(frozen=True)
class Begin:
    """What a navigator starts from."""

    initial: InitialState
    alignment: Alignment


def begin(model: ErrorModel, rng: np.random.Generator | None = None, laps: int = 4) -> Begin:
    """Start of the drive, with errors drawn from the initial covariance if there is a generator."""
    motion = truth(laps)
    at = motion.evaluate(np.array([motion.start]))
    error = np.zeros(9) if rng is None else rng.standard_normal(9) * START_SD
    lla = lla_offset(at.lla[0], error[:3])
    v_n = at.v_n[0] + error[3:6]
    # C_hat = (I - [phi x]) C
    rph = rph_from_quat(quat_multiply(quat_from_rotvec(-error[6:]), quat_from_rph(at.rph[0])))
    alignment = Alignment(motion.start, rph, START_SD[6:], np.zeros(3), np.full(3, np.inf), None, *GIVEN)
    return Begin(initial_state(alignment, model, lla, v_n, START_SD[:3], START_SD[3:6]), alignment)


HOMES = {
    "lever_b": "receiver.lever_arm.value",
    "lever_sd": "receiver.lever_arm.sd",
    "delay": "receiver.delay.value",
    "delay_sd": "receiver.delay.sd",
    "least_delay_sd": "receiver.delay.least_sd",
    "settled": "receiver.delay.settled",
    "velocity_lag": "receiver.lag.value",
    "output_interval": "output.interval",
    "aiding": "aiding.measurements",
} | {
    name: f"{part}.{name}"
    for part, names in {
        "receiver": "correlated jitter heading_sd",
        "output": "smooth epochs point_b",
        "explained": "changes false rough",
    }.items()
    for name in names.split()
}


def changed(ready: FilterInput, **values: object) -> FilterInput:
    """The same with other values of the fields that `HOMES` names, or of its own."""
    for name, value in values.items():
        ready = _replaced(ready, HOMES.get(name, name).split("."), value)
    return ready


def _replaced(owner: Any, path: list[str], value: object) -> Any:
    first, *rest = path
    return replace(owner, **{first: _replaced(getattr(owner, first), rest, value) if rest else value})


def ready(
    imu: ImuData, gps: GpsData, start: Begin, model: ErrorModel | None = None, nominal: float = 0.02, **values: object
) -> FilterInput:
    """Input of the filter; `values`: see `changed`."""
    starts = (Part(float(imu.time[0]), start.alignment, start.initial),)
    return changed(FilterInput(imu, gps, model or MODEL, starts, nominal), **{"lever_b": LEVER_B, **values})


def navigate(
    imu: ImuData,
    gps: GpsData,
    start: Begin,
    model: ErrorModel,
    *,
    blocks: int | None = None,
    **settings: object,
) -> Run:
    """Run the filter over the drive, fed in blocks of so many samples."""
    nominal = float(np.median(np.diff(imu.time)))
    navigator = Navigator(ready(imu, gps, start, model, nominal, **{"output_interval": 1.0, **settings}))
    size = blocks or imu.time.size
    for k in range(0, imu.time.size, size):
        part = slice(k, k + size)
        navigator.feed(ImuData(imu.time[part], imu.gyro[part], imu.accel[part], imu.sampling, imu.stamp))
    return navigator.finish()


def attitude_error(q_nb: FloatArray, rph: FloatArray) -> FloatArray:
    """``phi`` of C_hat = (I - [phi x]) C, (n, 3) [rad]."""
    product = quat_multiply(q_nb, quat_conjugate(quat_from_rph(rph)))
    return -2.0 * product[:, 1:] * np.sign(product[:, :1])


MODEL = error_model(SPEC, 21)
UNFAILING = Gates(probability=1 - 1e-9)  # keeps every fix that is what it claims to be


def without_velocities(gps: GpsData) -> GpsData:
    """Fixes that are positions alone."""
    none = np.full_like(gps.v_n, np.nan)
    return replace(gps, v_n=none, velocity_sd=none)
