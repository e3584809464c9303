"""Runs made from closed forms, for tests of what is written and drawn."""

from __future__ import annotations

import numpy as np

from insnav.attitude import quat_from_rph
from insnav.earth import lla_offset
from insnav.findings import Code, Finding
from insnav.types import Alignment, Epochs, GpsData, Innovations, Run, SensorErrors, Trajectory
from insnav.units import DEG, DEG_PER_H, G0

ORIGIN = np.array([45.0 * DEG, 7.6 * DEG, 240.0])


def truth(duration: float = 1800.0, rate: float = 10.0, static: float = 300.0) -> Trajectory:
    """At rest, then loops of 300 m radius that drift east, at up to 12 m/s."""
    t = np.arange(0.0, duration + 0.5 / rate, 1.0 / rate)
    driving = np.clip(t - static, 0.0, None)
    phase = 0.03 * (driving - 20.0 * (1.0 - np.exp(-driving / 20.0)))
    rate_of = 0.03 * (1.0 - np.exp(-driving / 20.0))
    north, east = 300.0 * np.sin(phase), 300.0 * (1.0 - np.cos(phase)) + 40.0 * phase
    down = -10.0 * (1.0 - np.cos(0.5 * phase))
    v = np.column_stack(
        (
            300.0 * np.cos(phase) * rate_of,
            (300.0 * np.sin(phase) + 40.0) * rate_of,
            -5.0 * np.sin(0.5 * phase) * rate_of,
        )
    )
    heading = np.where(driving > 0.0, np.arctan2(300.0 * np.sin(phase) + 40.0, 300.0 * np.cos(phase)), 0.1326)
    rph = np.column_stack((0.05 * np.sin(phase), 0.02 * np.cos(phase), heading % (2.0 * np.pi)))
    return Trajectory(t, lla_offset(ORIGIN, np.column_stack((north, east, down))), v, rph)


def drive(
    duration: float = 1800.0,
    *,
    rate: float = 10.0,
    outage: tuple[float, float] = (900.0, 960.0),
    velocity: bool = True,
    seed: int = 7,
) -> tuple[Run, GpsData, Trajectory]:
    """A run with an outage and three rejected fixes, its fixes, and its truth."""
    rng = np.random.default_rng(seed)
    true = truth(duration, rate)
    t = true.time
    lost = np.clip(np.where((t > outage[0]) & (t < outage[1]), t - outage[0], 0.0), 0.0, None)
    sd = np.column_stack(
        [0.4 + 0.002 * lost**2 + 0.3 * np.exp(-t / 60.0)] * 3
        + [0.03 + 0.002 * lost + 0.02 * np.exp(-t / 60.0)] * 3
        + [0.03 * DEG * (1.0 + np.exp(-t / 60.0))] * 2
        + [(0.2 + 2.0 * np.exp(-t / 200.0)) * DEG]
    )
    memory = (30.0, 30.0, 60.0, 20.0, 20.0, 20.0, 80.0, 80.0, 120.0)
    slow = np.column_stack([_coloured(rng, t, tau) for tau in memory])
    error = slow * sd
    solution = Trajectory(
        t,
        lla_offset(true.lla, error[:, 0:3]),
        true.v_n + error[:, 3:6],
        np.column_stack((true.rph[:, :2] + error[:, 6:8], (true.rph[:, 2] + error[:, 8]) % (2.0 * np.pi))),
        sd,
    )
    rows = np.flatnonzero(np.isclose(t % 1.0, 0.0, atol=1e-6) & ((t <= outage[0]) | (t >= outage[1])))
    m = len(rows)
    sd_in = np.column_stack([np.hypot(sd[rows, i], 1.5 if i < 3 else 0.1) for i in range(6)])
    innovation = rng.normal(size=(m, 6)) * sd_in
    used_p, used_v = np.ones(m, dtype=bool), np.ones(m, dtype=bool)
    for row, size in ((m // 2, 60.0), (m // 2 + 1, 60.0), (2 * m // 3, -4000.0)):
        innovation[row, 1] = size
        used_p[row] = False
    if not velocity:
        innovation[:, 3:], sd_in[:, 3:], used_v[:] = np.nan, np.nan, False
    nis = np.square(innovation / sd_in)
    innovations = Innovations(
        t[rows], innovation, sd_in, nis[:, :3].sum(axis=1), nis[:, 3:].sum(axis=1), used_p, used_v
    )
    noise = rng.normal(size=(m, 3)) * 1.5
    noise[~used_p, 1] = innovation[~used_p, 1]
    v_n = true.v_n[rows] + rng.normal(size=(m, 3)) * 0.1 if velocity else np.full((m, 3), np.nan)
    gps = GpsData(t[rows], lla_offset(true.lla[rows], noise), v_n, np.full((m, 3), 1.5), np.full((m, 3), 0.1))
    events = tuple(
        Finding.of(Code.GATE_POSITION, time, nis=float(value), limit_nis=21.1)
        for time, value in zip(t[rows][~used_p].tolist(), nis[~used_p, :3].sum(axis=1), strict=True)
    )
    alignment = Alignment(
        0.0,
        true.rph[0],
        np.array([0.05, 0.05, 2.0]) * DEG,
        np.array([10.0, -5.0, 3.0]) * DEG_PER_H,
        np.full(3, 2.0) * DEG_PER_H,
        (0.0, 300.0),
        "levelling at rest",
        "course of the GPS",
    )
    epochs = Epochs(
        t[rows],
        solution.lla[rows],
        solution.v_n[rows],
        quat_from_rph(solution.rph[rows]),
        np.square(sd[rows])[:, :, None] * np.eye(9),
    )
    run = Run(solution, innovations, _sensor_errors(t[rows], rng), events, alignment, epochs, 0.05, 0.01)
    return run, gps, true


def _sensor_errors(time: np.ndarray, rng: np.random.Generator) -> SensorErrors:
    scale = np.repeat([20.0 * DEG_PER_H, 2e-3 * G0, 500e-6, 800e-6], 3)
    settled = np.exp(-time / 250.0)[:, None]
    sd = scale * (0.1 + 0.9 * settled)
    value = scale * rng.normal(size=12) * (1.0 - settled) + 0.02 * scale * np.column_stack(
        [_coloured(rng, time, 50.0) for _ in range(12)]
    )
    return SensorErrors(time, value, sd)


def _coloured(rng: np.random.Generator, time: np.ndarray, tau: float) -> np.ndarray:
    """Unit-variance noise of correlation time about `tau`."""
    step = float(np.median(np.diff(time)))
    width = max(1, int(tau / step))
    white = rng.normal(size=len(time) + width - 1)
    summed = np.concatenate(([0.0], np.cumsum(white)))
    return np.asarray((summed[width:] - summed[:-width]) / np.sqrt(width))
