"""Cost of the online filter in blocks of ten samples, as a ratio to a predict of its Kalman filter."""

from __future__ import annotations

import time
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
    """Blocks and predicts take turns of milliseconds: a machine changes its pace, and the ratio does not."""
    nav, imu, gps = started(often)
    engine, number, ratios = Engine(np.eye(21)), 20, []
    phi, q = np.eye(21), np.zeros((21, 21))
    for part in np.split(np.arange(20_000), 4 * REPEATS):
        predicts = blocks = 0.0
        for turn in np.split(part, 10):
            span = imu.rows(turn)
            fixes = gps.rows((gps.time >= span.time[0]) & (gps.time <= span.time[-1]))
            begin = time.process_time()
            for _ in range(number):
                engine.predict(phi, q, 0.0)
            between = time.process_time()
            feed(nav, span, fixes)
            predicts, blocks = predicts + between - begin, blocks + time.process_time() - between
        ratios.append(blocks / (part.size / BLOCK) / (predicts / (10 * number)))
    print(f"a block costs {np.median(ratios):.1f} predicts; the last {1e6 * blocks / part.size:.1f} us a sample")
    assert np.median(ratios) < most


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
