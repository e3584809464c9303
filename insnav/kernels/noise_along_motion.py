"""Short-form noise laws along a motion: pulse responses at every instant, squared and summed."""

from __future__ import annotations

import numpy as np

from insnav.kernels import inner, njit


@inner()
def _answer(since, rate, given, velocity, position, out):  # type: ignore[no-untyped-def]
    """Compute errors some time after a pulse of attitude, velocity and position.

    velocity, position (3,): integrals of the specific force since then. rate: of the Schuler loop [rad/s].
    """
    x = rate * since
    once = twice = thrice = 1.0
    if x > 1e-4:
        once, twice, thrice = np.cos(x), np.sin(x) / x, 2.0 * (1.0 - np.cos(x)) / (x * x)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        if i == 2:
            once = twice = thrice = 1.0
        tilted = velocity[j] * given[k] - velocity[k] * given[j], position[j] * given[k] - position[k] * given[j]
        out[i] = thrice * tilted[1] + twice * since * given[3 + i] + given[6 + i]
        out[3 + i] = twice * tilted[0] + once * given[3 + i]
        out[6 + i] = once * given[i]


@njit(cache=True)
def noise_variances(  # type: ignore[no-untyped-def]
    dt, velocity, position, given, rate, rows, white, drive, first, fade, gained, alone, out
):
    """Compute the variances from one noise: white noise, random walks, Gauss-Markov processes.

    `dt` (m,): steps [s]. `velocity`, `position` (m + 1, 3): first and second integral of the specific force, North,
    East, Down, at the edges of the steps. `given` (m, 9): rate of attitude, velocity and position errors per unit of
    the noise. `rate` (r,): Schuler rate at each row, zero for the short forms [rad/s]. `rows` (r,) int: steps after
    which the variances are stored. `white`, `drive`, `first` (p,), per process: density of its white part, density of
    its random walk, variance of its Gauss-Markov part. `fade`, `gained`, `alone` (m, p): decay of a Gauss-Markov
    process over a step, its integral, and variance of the integrated process for unit variance. `out` (r, 9):
    variances.
    """
    h, moved, placed = np.empty(9), np.empty(3), np.empty(3)
    for r in range(rows.shape[0]):
        out[r] = 0.0
        whole, later = np.zeros(9), np.zeros((white.shape[0], 9))
        end, since = rows[r], 0.0
        for k in range(end - 1, -1, -1):
            since += 0.5 * dt[k]
            for i in range(3):
                middle = 0.5 * (velocity[k, i] + velocity[k + 1, i])
                # means over the step, and means of the products with time
                at = 0.5 * (position[k, i] + position[k + 1, i]) - dt[k] * (velocity[k + 1, i] - velocity[k, i]) / 6.0
                moved[i] = velocity[end, i] - middle
                placed[i] = position[end, i] - at - since * middle
            _answer(since, rate[r], given[k], moved, placed, h)
            for p in range(white.shape[0]):
                for i in range(9):
                    total = white[p] * dt[k] * h[i] * h[i]
                    if drive[p] > 0.0:
                        a = whole[i] + h[i] * dt[k]
                        total += drive[p] * dt[k] * (whole[i] * whole[i] + whole[i] * a + a * a) / 3.0
                    if first[p] > 0.0:
                        total += first[p] * h[i] * (alone[k, p] * h[i] + 2.0 * gained[k, p] * later[p, i])
                        later[p, i] = fade[k, p] * later[p, i] + gained[k, p] * h[i]
                    out[r, i] += total
            for i in range(9):
                whole[i] += h[i] * dt[k]
            since += 0.5 * dt[k]
