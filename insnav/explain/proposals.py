"""Proposals: faults with the largest predicted gain, by the scores of one pass.

A step of variance t has score r and information N. Its gain is r' (I/t + N)^-1 r - log det(I + t N), less the cost of
its prior. This is twice the gain of the log-likelihood (M. E. Tipping, A. C. Faul, "Fast marginal likelihood
maximisation for sparse Bayesian models", AISTATS 2003). An episode is a pair of opposite steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from insnav.explain.kinds import HOUR, RETURN, Kind, cost_of_end
from insnav.explain.record import LinearRecord, Pass, Step
from insnav.kernels.linear import gains
from insnav.types import FloatArray, IntArray

SIZES = 10.0 ** np.arange(-2.0, 4.1, 0.5)  # tested variances, relative to the square of the typical size [-]
REACH = 150.0  # longest tested episode [s]
SETTLES = 2.0  # least length of an episode, in epochs [-]
TOPS, APART = 5, 8.0  # number of tested maxima of a gain, and their least distance [s]
SHORTEST = 5  # interval of noise, in epochs
NONE = np.empty((0, 2), dtype=np.int64)
BLOCK = 60.0  # length of the parts of a drive whose largest gains measure the misfit of the model [s]
MOVING = "offset", "drag", "followed_drag"  # kinds after which the fixes may return
FEWEST = 4  # least number of parts for quartiles
FALSE_ALARMS = 0.01  # rate of false alarms of a kind by misfit of the model [1/h]


class Proposal(NamedTuple):
    """Faults that may explain the record better."""

    gain: float  # predicted, priors included [-]
    steps: tuple[Step, ...]


def score_kind(kind: Kind, score: FloatArray, information: FloatArray, interval: float) -> tuple[FloatArray, ...]:
    """Compute the gain of the best step of one kind before each epoch, and its variance, (m,).

    `score` (m, d), `information` (m, d, d): see `LinearRecord.project`. `interval`: between epochs [s].
    """
    variances = kind.size**2 * SIZES
    gain = gains_of(score, information, variances) - kind.cost(variances, interval)[:, None]
    gain[:, : int(SETTLES)] = -np.inf
    return gain.max(axis=0), variances[gain.argmax(axis=0)]


def gains_of(score: FloatArray, information: FloatArray, variances: FloatArray) -> FloatArray:
    """Compute twice the gain of the log-likelihood by steps of variances (k,), without priors, (k, m).

    One infinite variance gives the largest likelihood, r' N^-1 r.
    """
    found = np.empty((variances.size, score.shape[0]))
    if np.isfinite(variances).all():
        gains(*map(np.ascontiguousarray, (score, information)), variances, found)
        return found
    size, vectors = np.linalg.eigh(information)
    square = np.einsum("mab,ma->mb", vectors, score) ** 2
    return np.asarray((square / np.maximum(size, 1e-9 * size[:, -1:] + 1e-30)).sum(axis=1))[None]


def misfit_of(record: LinearRecord, of: Pass, kind: Kind, beside: Sequence[int] = ()) -> float:
    """Estimate from the drive the gain without priors that misfit of the model reaches `FALSE_ALARMS` times an hour.

    `beside`: epochs of faults. Their parts of the drive are not used.

    The largest r' N^-1 r of each part follow a Gumbel distribution (E. J. Gumbel, "Statistics of Extremes", 1958). The
    quartiles give two scales, and the larger scale is used.
    """
    gain = gains_of(*record.project(of, kind), np.array([np.inf]))[0]
    block = np.floor((record.time - record.time[0]) / BLOCK).astype(int)
    numbers, firsts = np.unique(block, return_index=True)
    if firsts.size < FEWEST:
        return 0.0
    levels = np.array([0.25, 0.5, 0.75])
    other = ~np.isin(numbers, block[list(beside)])
    largest = np.quantile(np.maximum.reduceat(gain, firsts)[other if other.sum() >= FEWEST else slice(None)], levels)
    reduced = -np.log(-np.log(levels))
    scale = (np.diff(largest) / np.diff(reduced)).max()
    return float(largest[1] + scale * (-np.log(FALSE_ALARMS * BLOCK / HOUR) - reduced[1]))


def propose(
    record: LinearRecord,
    of: Pass,
    kinds: Sequence[Kind],
    known: tuple[Step, ...],
    near: Sequence[int] = (),
    *,
    false: IntArray = NONE,
    believed: bool = False,
) -> list[Proposal]:
    """Propose steps, episodes, intervals of noise and ends in addition to the known faults, the best first.

    `near`: epochs at which episodes begin or end, instead of the maxima of each kind. `false` (k, 2): begin and end of
    long series of false fixes, additional episodes. `believed`: these fixes have weight one. Their errors then spread
    in the smoothed states, so they are the only intervals of noise. If a series lasts to the end, the IMU may be wrong.
    """
    found: list[Proposal] = []
    ends = cost_of_end(record.interval)
    for kind in kinds:
        if record.columns(kind).shape[1] == 0:
            continue
        seen = record.project(of, kind)
        if kind.fills:
            ended = false[false[:, 1] < record.time.size]
            found += _interval(record, seen, kind, ended if believed and ended.size else None)
            continue
        gain_at, variance_at = score_kind(kind, *seen, record.interval)
        row = int(gain_at.argmax())
        found.append(Proposal(float(gain_at[row]), (Step(kind, row, float(variance_at[row])),)))
        if kind.name == "offset" and any(step.kind.name in MOVING for step in known):
            prior = float(kind.cost(variance_at[row], record.interval)) - ends
            found.append(Proposal(float(gain_at[row]) + prior, (Step(RETURN, row, 0.0),)))
        if kind.passes:
            pairs = _pairs(record, of, kind, seen, near or (*false[:, 0].tolist(), *_tops(record, gain_at)))
            for begin, end, gain, variance in sorted(pairs, key=lambda pair: -pair[2])[:2]:
                prior = float(kind.cost(variance, record.interval)) + ends
                found.append(Proposal(gain - prior, (Step(kind, begin, variance, end),)))
    for number, step in enumerate(known):
        if not step.end and step.kind.passes:
            found += _end(record, of, known, number, ends)
    return sorted((each for each in found if np.isfinite(each.gain)), key=lambda each: -each.gain)


def _end(record: LinearRecord, of: Pass, known: tuple[Step, ...], number: int, prior: float) -> list[Proposal]:
    """Propose the end of a known fault without an end."""
    step = known[number]
    gain = gains_of(*record.project(of, step.kind), np.array([step.variance]))[0] - prior
    gain[: step.begin + 1] = -np.inf
    row = int(gain.argmax())
    return [Proposal(gain[row], (*known[:number], step.moved(step.begin, row), *known[number + 1 :]))]


def _pairs(
    record: LinearRecord, of: Pass, kind: Kind, seen: tuple[FloatArray, FloatArray], tops: Sequence[int]
) -> set[tuple[int, int, float, float]]:
    """Find the best episode from each epoch, by alternating between its end and its begin; gain without prior.

    `seen`: score and information of a step before each epoch.
    """
    columns, m, variances = record.columns(kind), record.time.size, kind.size**2 * SIZES
    score, information = seen
    reach, prior = max(int(REACH / record.interval), 3), kind.cost(variances, record.interval)[:, None]

    @cache
    def best_from(at: int, side: int) -> tuple[int, int, float, float] | None:
        rows = np.arange(at + int(SETTLES), min(at + reach, m)) if side > 0 else np.arange(max(at - reach, 1), at - 1)
        if rows.size == 0:
            return None
        cross = record.cross(of, columns, at, side * reach)[rows]
        apart = information[at] + information[rows] - cross - np.swapaxes(cross, 1, 2)
        gain = gains_of(side * (score[at] - score[rows]), apart, variances)
        size, place = np.unravel_index(int((gain - prior).argmax()), gain.shape)
        other = int(rows[place])
        return min(at, other), max(at, other), float(gain[size, place]), float(variances[size])

    found = set[tuple[int, int, float, float]]()
    for top in tops:
        at, side, best = top, 1, best_from(top, 1)
        if best is None:
            at, side, best = top, -1, best_from(top, -1)
        while best is not None:
            at, side = best[1] if side > 0 else best[0], -side
            again = best_from(at, side)
            if again is None or again[2] <= best[2] + 1e-6:
                found.add(best)
                break
            best = again
    return found


def _interval(
    record: LinearRecord, seen: tuple[FloatArray, FloatArray], kind: Kind, at: IntArray | None
) -> list[Proposal]:
    """Propose the interval of noise with the largest sum of gains, of all intervals or of those `at` given epochs.

    The sum treats the steps of all epochs as independent. It only selects the interval to test.
    """
    variances, found = kind.size**2 * SIZES, []
    for variance, gain in zip(variances, gains_of(*seen, variances), strict=True):
        whole = np.concatenate([[0.0], np.cumsum(gain)])
        last = int((whole - np.minimum.accumulate(whole)).argmax())
        prior = float(kind.cost(variance, record.interval)) + cost_of_end(record.interval)
        for begin, end in [(int(whole[: last + 1].argmin()), last)] if at is None else at.tolist():
            if end > begin + SHORTEST:
                step = Step(kind, max(begin, 1), float(variance), min(end, record.time.size - 1))
                found.append(Proposal(float(whole[end] - whole[begin]) - prior, (step,)))
    return sorted(found, key=lambda each: -each.gain)[:1]


def _tops(record: LinearRecord, gain: FloatArray) -> list[int]:
    """Find the epochs of the largest gains, at least `APART` from each other."""
    left, found = gain.copy(), []
    for _ in range(TOPS):
        row = int(left.argmax())
        found.append(row)
        left[np.abs(record.time - record.time[row]) < APART] = -np.inf
    return found
