"""Six axes against six calls of allantools, side by side in one process."""

from __future__ import annotations

from tests.bench.allan import AllanPair, allan_pair

SAMPLES = 500_000
WALL_RATIO, CPU_RATIO = 3.0, 2.0


def fast(pair: AllanPair) -> bool:
    return pair.cpu_ratio >= CPU_RATIO and pair.wall_ratio >= WALL_RATIO


def test_six_axes_are_faster_than_six_calls_of_allantools() -> None:
    pair = allan_pair(SAMPLES, 3, fast)
    assert pair.difference < 1e-12
    assert fast(pair), f"{pair.wall_ratio:.2f} wall, {pair.cpu_ratio:.2f} CPU"
