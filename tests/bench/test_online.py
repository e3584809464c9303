"""Cost of the online filter in blocks of ten samples, as a ratio to a predict of its Kalman filter."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import insnav
from insnav.filter.estimate import Engine
from insnav.simulate.recording import load_gps
from insnav.types import GpsData, ImuData

# Twenty microseconds a sample are two hundred a block, where a predict of 21 states by filterpy takes five.
BLOCK, PREDICTS, LATE = 10, 40.0, 3.0
REPEATS = 5


def best(work: Callable[[], object]) -> float:
    """Least CPU time of some repetitions [s]."""
    taken = []
    for _ in range(REPEATS):
        begin = time.process_time()
        work()
        taken.append(time.process_time() - begin)
    return min(taken)


def started(often: float = 1.0) -> tuple[insnav.OnlineFilter, ImuData, GpsData]:
    """A filter that has navigated for a while."""
    made = insnav.simulate("city", imu="automotive", gps=replace(load_gps("single"), rate=often), seed=3)
    assert made.gps is not None
    imu, gps = made.imu.data, made.gps.data
    nav = insnav.OnlineFilter("automotive", lever_arm=(0.0, 0.0, 0.0), gps_delay=0.0)
    feed(nav, imu.rows(imu.time < 150.0), gps.rows(gps.time < 150.0))
    assert nav.state.aligned
    return nav, imu.rows(imu.time >= 150.0), gps.rows(gps.time >= 150.0)


def feed(nav: insnav.OnlineFilter, imu: ImuData, gps: GpsData, late: float = 0.0) -> None:
    """Blocks of ten samples, and each fix when it arrives."""
    row = 0
    for first in range(0, imu.time.size, BLOCK):
        block = slice(first, first + BLOCK)
        nav.imu(imu.time[block], imu.gyro[block], imu.accel[block])
        while row < gps.time.size and gps.time[row] + late <= imu.time[block][-1]:
            nav.gps(gps.time[row], gps.lla[row], gps.v_n[row], gps.position_sd[row])
            row += 1


@pytest.mark.parametrize(("often", "most"), [(1.0, PREDICTS), (5.0, 1.5 * PREDICTS)], ids=["1 Hz", "5 Hz"])
def test_a_block_costs_few_predicts_of_the_filter(often: float, most: float) -> None:
    """With fixes at some rate. At 5 Hz it is 29 predicts on an idle machine, and 42 beside other tests."""
    nav, imu, gps = started(often)
    engine, number = Engine(np.eye(21)), 400
    phi, q = np.eye(21), np.zeros((21, 21))
    predicts, blocks = [], []
    for part in np.split(np.arange(min(40_000, imu.time.size // BLOCK * BLOCK)), 2 * REPEATS):  # machines change pace
        predicts.append(best(lambda: [engine.predict(phi, q, 0.0) for _ in range(number)]) / number)
        begin = time.process_time()
        span = imu.rows(part)
        feed(nav, span, gps.rows((gps.time >= span.time[0]) & (gps.time <= span.time[-1])))
        blocks.append((time.process_time() - begin) / (part.size / BLOCK))
        if len(blocks) >= REPEATS and min(blocks) < most * min(predicts):
            break
    sample = 1e6 * min(blocks) / BLOCK
    print(f"{sample:.1f} us a sample; a block costs {min(blocks) / min(predicts):.1f} predicts")
    assert min(blocks) < most * min(predicts)


def test_late_fixes_cost_little_more() -> None:
    costs = []
    for late in (0.0, 1.5):
        nav, imu, gps = started()
        rows = np.split(np.arange(20_000), REPEATS)
        taken = []
        for part in rows:
            span = imu.rows(part)
            begin = time.process_time()
            feed(nav, span, gps.rows((gps.time >= span.time[0]) & (gps.time <= span.time[-1])), late)
            taken.append(time.process_time() - begin)
        costs.append(min(taken))
    print(f"fixes 1.5 s late cost {costs[1] / costs[0]:.2f} times as much")
    assert costs[1] < LATE * costs[0]
