"""Passes over the linear record beside dense linear algebra, in the same run."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from insnav.kernels.linear import backward, forward

N, WITH_SENSORS, EPOCHS, REPEAT = 52, 33, 200, 15


def cpu(function: Callable[[], object]) -> float:
    begin = time.thread_time()
    function()
    return time.thread_time() - begin


def test_a_pass_each_way_costs_less_than_dense_propagation() -> None:
    """A filter of dense matrices multiplies 2 n^3 times for F P F' alone, without measurements and a way back."""
    random = np.random.default_rng(1)
    phi = np.zeros((EPOCHS, 9, WITH_SENSORS)) + np.eye(9, WITH_SENSORS)
    phi[:, :, 9:] = 0.01 * random.normal(size=(EPOCHS, 9, WITH_SENSORS - 9))
    faults = np.arange(N) >= N - 9
    noise = np.broadcast_to(0.01 * np.eye(9), (EPOCHS, 9, 9)).copy()
    driving = np.broadcast_to(0.001 * ~faults, (EPOCHS, N)).copy()
    cleared = np.zeros(EPOCHS, np.int64)
    system = np.ones(EPOCHS), phi, np.full((EPOCHS, N), 0.99), noise, driving, cleared
    h = random.normal(size=(EPOCHS, 6, N)) * (random.random(N) < 0.2)
    measured = random.normal(size=(EPOCHS, 6)), h, np.ones((EPOCHS, 6)), np.zeros((EPOCHS, N))
    start, jumps = (np.zeros(N), np.diag(1.0 - faults)), (np.array([100]), np.eye(N, 3, 9 - N)[None])
    told = np.arange(12), np.empty((EPOCHS, 12)), np.empty((EPOCHS, 12, N))
    out = (*np.empty((2, EPOCHS, 6)), np.empty((EPOCHS, 6, N)), *told)
    rows = np.array([0, 100])  # start and fault: few passes of the search keep the information of all epochs
    back = np.empty((2, N)), np.empty((2, N, N)), *np.empty((2, EPOCHS, 6)), np.empty((EPOCHS, 4, 12))
    f = 0.1 * random.normal(size=(N, N))

    def propagate() -> None:
        for _ in range(EPOCHS):
            f @ f @ f.T

    def both_ways() -> None:
        forward(system, measured, start, jumps, out)
        backward(system, measured, out, rows, *back, np.empty(EPOCHS))

    both_ways()  # compiles, if that is to do
    pairs = np.array([(cpu(both_ways), cpu(propagate)) for _ in range(REPEAT)])  # in turns: machines change pace
    passes, dense = pairs.min(axis=0)
    print(f"forward and backward {1e6 * passes / EPOCHS:.1f} us an epoch, dense propagation {1e6 * dense / EPOCHS:.1f}")
    assert passes < dense
