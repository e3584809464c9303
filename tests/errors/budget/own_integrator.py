"""Free-inertial navigation in Earth-fixed axes, many runs at once, of nothing that insnav computes: an oracle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from insnav.errors.budget.sources import SampledMotion, Source
from insnav.simulate.sensor_errors import flicker

MU, J2, RADIUS, OMEGA = 3.986004418e14, 1.08262982e-3, 6378137.0, np.array([0.0, 0.0, 7.292115e-5])


def gravitation(r: np.ndarray) -> np.ndarray:
    """Of an ellipsoidal Earth to J2, less the centrifugal part, Earth-fixed (runs, 3)."""
    size = np.linalg.norm(r, axis=-1, keepdims=True)
    z2 = (r[..., 2:] / size) ** 2
    bend = 1.5 * J2 * (RADIUS / size) ** 2
    found = -MU * r / size**3 * (1.0 + bend * (np.array([1.0, 1.0, 3.0]) - 5.0 * z2))
    return found - np.cross(OMEGA, np.cross(OMEGA, r))


def axes(lat: float, lon: float) -> np.ndarray:
    """Columns: North, East, Down in Earth-fixed axes."""
    s, c, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    return np.array([[-s * cl, -sl, -c * cl], [-s * sl, cl, -c * sl], [c, 0.0, -s]])


def turned(v: np.ndarray) -> np.ndarray:
    """Rotation matrices of rotation vectors (runs, 3), by Rodrigues."""
    size = np.linalg.norm(v, axis=-1)[:, None, None]
    k = np.zeros((len(v), 3, 3))
    k[:, 0, 1], k[:, 0, 2], k[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    k -= np.swapaxes(k, 1, 2)
    small = np.maximum(size, 1e-12)
    return np.eye(3) + np.sin(small) / small * k + (1.0 - np.cos(small)) / small**2 * k @ k


def errors_of_runs(
    motion: SampledMotion,
    wrong: Callable[[int], tuple[np.ndarray, np.ndarray]],
    start: np.ndarray,
    rows: np.ndarray,
    gravity: np.ndarray,
) -> np.ndarray:
    """RMS position errors North, East, Down, (m, 3).

    `wrong`: errors of gyros and accelerometers in sample k, both (runs, 3); `start` (runs, 9): errors of position,
    velocity, attitude; `gravity` (runs, 3): error of gravity [m/s^2].
    """
    lat, lon, height = motion.truth.lla[0]
    e2 = 6.69437999014e-3
    normal = RADIUS / np.sqrt(1.0 - e2 * np.sin(lat) ** 2)
    place = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat) * (1.0 - e2)])
    to_e = axes(lat, lon)
    begin = normal * place + height * (-to_e[:, 2])
    # the last run has no errors: the others are compared with it, so what the integrator does badly drops out
    start = np.vstack([start, np.zeros(9)])
    r = begin + start[:, :3] @ to_e.T
    v = (motion.truth.v_n[0] + start[:, 3:6]) @ to_e.T
    roll, pitch, yaw = motion.truth.rph[0]
    body = np.eye(3)
    for axis, angle in ((2, yaw), (1, pitch), (0, roll)):
        body = body @ turned(angle * np.eye(3)[axis][None])[0]
    attitude = to_e @ turned(-start[:, 6:]) @ body
    off = np.vstack([gravity, np.zeros(3)]) @ to_e.T
    found = []
    for k in range(int(rows[-1])):
        dt = motion.dt[k]
        gyro, accel = wrong(k)
        rate = np.vstack([motion.rate[k] + gyro, motion.rate[k]])
        force = np.vstack([motion.force[k] + accel, motion.force[k]])
        middle = attitude @ turned(0.5 * dt * rate)
        middle = turned(np.tile(-0.5 * dt * OMEGA, (len(rate), 1))) @ middle
        push = np.einsum("rij,rj->ri", middle, force) + gravitation(r + 0.5 * dt * v) - 2.0 * np.cross(OMEGA, v) + off
        r = r + dt * v + 0.5 * dt**2 * push
        v = v + dt * push
        attitude = turned(np.tile(-dt * OMEGA, (len(rate), 1))) @ attitude @ turned(dt * rate)
        if k + 1 in rows:
            here = axes(*motion.truth.lla[k + 1, :2])
            found.append(np.sqrt(np.mean(((r[:-1] - r[-1]) @ here) ** 2, axis=0)))
    return np.array(found)


def monte_carlo(
    sources: tuple[Source, ...], motion: SampledMotion, rows: np.ndarray, runs: int, seed: int
) -> np.ndarray:
    """RMS position errors by one family, sampled from what its standard deviations say, (m, 3)."""
    rng = np.random.default_rng(seed)
    n, dt = int(rows[-1]), float(motion.dt[0])
    start, gravity = np.zeros((runs, 9)), np.zeros((runs, 3))
    factor = np.zeros((2, runs, 3, 3))
    first, group = sources[0], sources[0].group
    local = ("north", "east", "down")
    noise = None
    sd = np.array([s.sd for s in sources])
    if group == "initial":
        column = {"position": 0, "velocity": 3, "tilt": 6, "heading": 6}[first.term]
        for s in sources:
            start[:, column + local.index(s.axis)] = s.sd * rng.standard_normal(runs)
    elif group == "gravity":
        for s in sources:
            gravity[:, local.index(s.axis)] = s.sd * rng.standard_normal(runs)
    elif first.kind in ("constant", "ramp"):
        for s in sources:
            i, j = s.element
            factor[int(group == "accel"), :, i, j] = s.sd * rng.standard_normal(runs)
    else:
        tau, shape = first.correlation_time, (n, runs, 3)
        pulses = rng.standard_normal(shape)
        if first.kind == "white":
            noise = pulses / np.sqrt(dt)
        elif first.kind == "random walk":
            noise = np.cumsum(pulses, axis=0) * np.sqrt(dt)
        elif first.kind == "quantisation":
            noise = np.diff(pulses, axis=0, prepend=0.0) / dt
        elif first.kind == "Gauss-Markov":
            noise, keep = pulses, np.exp(-dt / tau)
            for k in range(1, n):
                noise[k] = keep * noise[k - 1] + np.sqrt(1.0 - keep**2) * pulses[k]
        else:
            ones = np.ones(3)
            seeds = np.random.SeedSequence(seed).spawn(runs)
            time = motion.elapsed[:n]
            noise = np.stack([flicker(each, time, ones) for each in seeds], axis=1)
        noise = noise * sd
    driven = {
        "scale factor": lambda w, f: (w, f),
        "misalignment": lambda w, f: (w, f),
        "asymmetry": lambda w, f: (abs(w), abs(f)),
        "non-linearity": lambda w, f: (w * w, f * f),
        "g-sensitivity": lambda w, f: (f, f),
    }.get(first.term, lambda w, f: (np.ones(3), np.ones(3)))
    none = np.zeros((runs, 3))

    def wrong(k: int) -> tuple[np.ndarray, np.ndarray]:
        if noise is not None:
            return (noise[k], none) if group == "gyro" else (none, noise[k])
        size = (k + 0.5) * dt if first.kind == "ramp" else 1.0
        gyro, accel = driven(motion.rate[k], motion.force[k])
        return size * factor[0] @ gyro, size * factor[1] @ accel

    return errors_of_runs(motion, wrong, start, rows, gravity)
