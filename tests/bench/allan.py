"""The Allan deviation of six axes beside allantools: time, CPU and agreement in one process.

Run as ``python -m tests.bench.allan`` for the full size.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import allantools
import numpy as np

from insnav.lab.noise.allan import allan_deviation, averaging_factors
from insnav.types import FloatArray

FULL, INTERVAL = 3_600_000, 0.005


@dataclass(frozen=True)
class AllanPair:
    """Cost of both, and how far they differ."""

    taus: int
    own_wall_s: float
    own_cpu_s: float
    peer_wall_s: float
    peer_cpu_s: float
    difference: float  # largest, relative

    @property
    def wall_ratio(self) -> float:
        return self.peer_wall_s / self.own_wall_s

    @property
    def cpu_ratio(self) -> float:
        return self.peer_cpu_s / self.own_cpu_s


def allan_pair(samples: int, attempts: int, enough: Callable[[AllanPair], bool] = lambda pair: False) -> AllanPair:
    """Six axes at the default averaging times, both in turn.

    Anything else that runs can only add to a time: the least of several attempts counts, and there is no further one
    once it is `enough`.
    """
    rng = np.random.default_rng(1)
    values = rng.standard_normal((samples, 6)) + np.array([0.0, 0.1, -0.2, 0.3, 1.0, -9.8])
    factors = averaging_factors(samples, INTERVAL)
    allan_deviation(values[:1000], INTERVAL, factors[:3])  # compiles
    least = (np.inf,) * 4
    for _ in range(attempts):
        found, *own = timed(lambda: allan_deviation(values, INTERVAL, factors).deviation)
        expected, *peer = timed(lambda: peer_deviation(values, factors * INTERVAL))
        least = tuple(map(min, zip(least, (*own, *peer), strict=True)))
        pair = AllanPair(factors.size, *least, float(np.max(np.abs(found / expected - 1.0))))
        if enough(pair):
            break
    return pair


def peer_deviation(values: FloatArray, taus: FloatArray) -> FloatArray:
    """Six calls of allantools with the same times."""
    columns = [allantools.oadev(v, rate=1.0 / INTERVAL, data_type="freq", taus=taus)[1] for v in values.T]
    return np.column_stack(columns)


def timed(work: Callable[[], FloatArray]) -> tuple[FloatArray, float, float]:
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return result, time.perf_counter() - wall, time.process_time() - cpu


if __name__ == "__main__":
    pair = allan_pair(FULL, attempts=2)
    print(f"six axes, {pair.taus} averaging times, {FULL} samples")
    print(f"insnav      {pair.own_wall_s:8.2f} s wall {pair.own_cpu_s:8.2f} s CPU")
    print(f"allantools  {pair.peer_wall_s:8.2f} s wall {pair.peer_cpu_s:8.2f} s CPU")
    print(f"ratio       {pair.wall_ratio:8.2f} wall   {pair.cpu_ratio:8.2f} CPU; agree to {pair.difference:.1e}")
