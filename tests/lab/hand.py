"""A hand calibration whose truth is known in closed form: rests, and turns about fixed axes between them."""

from __future__ import annotations

import numpy as np

from insnav.types import FloatArray, ImuData

G = 9.81
RATE = 50.0  # [Hz]


def turn(axis: FloatArray, angle: float) -> FloatArray:
    """Rotation matrix of body axes turned about an axis: takes coordinates after to those before (Rodrigues)."""
    x, y, z = axis
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def record(
    moves: list[tuple[FloatArray, float]], start: FloatArray, *, rest: float = 3.0, move: float = 1.6
) -> tuple[ImuData, FloatArray, list[tuple[int, int]]]:
    """Perfect samples of a sequence of turns ``(axis in the body, angle)``, directions and samples of the rests.

    Rates are exact means over the samples: about a fixed axis they are differences of the angle. The angle follows a
    sine law. The hand shakes at 3 Hz, which the accelerometers feel.
    """
    n_rest, n_move = round(rest * RATE), round(move * RATE)
    gyro, accel, rests, ups = [], [], [], []
    up = start / np.linalg.norm(start)
    count = 0
    for axis, angle in [*moves, (np.array([1.0, 0.0, 0.0]), 0.0)]:
        gyro.append(np.zeros((n_rest, 3)))
        accel.append(np.tile(G * up, (n_rest, 1)))
        rests.append((count, count + n_rest))
        ups.append(up)
        count += n_rest
        if len(rests) > len(moves):
            break
        share = np.arange(n_move + 1) / n_move
        way = angle * (share - np.sin(2.0 * np.pi * share) / (2.0 * np.pi))
        gyro.append(np.diff(way)[:, None] * RATE * axis)
        felt = np.array([turn(axis, w).T @ up for w in way[1:]])
        shaking = 2.0 * np.sin(2.0 * np.pi * 3.0 * share[1:, None] * move) * np.array([1.0, 0.6, -0.8])
        accel.append(G * felt + shaking)
        up = felt[-1]
        count += n_move
    time = np.arange(1, count + 1) / RATE
    return ImuData(time, np.concatenate(gyro), np.concatenate(accel)), np.array(ups), rests


def random_record(rng: np.random.Generator, poses: int) -> ImuData:
    """Poses anywhere on the sphere."""
    moves = []
    for _ in range(poses - 1):
        axis = rng.normal(size=3)
        moves.append((axis / np.linalg.norm(axis), float(rng.uniform(1.0, 2.5))))
    return record(moves, rng.normal(size=3))[0]
