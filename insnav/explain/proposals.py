"""Proposals: the faults with the largest predicted gain, from the scores of one pass over the linear record.

A pass yields the score r and the information N of a step before each epoch. A step of variance t increases twice the
log-likelihood by r' (I/t + N)^-1 r - log det(I + t N) (M. E. Tipping, A. C. Faul, "Fast marginal likelihood
maximisation for sparse Bayesian models", AISTATS 2003). Its gain is this increase less the cost of its prior. A fault
that ends, an episode, is a pair of opposite steps.
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
REACH = 150.0  # length of the longest tested episode [s]
SETTLES = 2  # least length of an episode, in epochs [-]
TOPS, APART = 5, 8.0  # number of tested maxima of the gain over time, and least time between them [s]
SHORTEST = 5  # length that an interval of noise must exceed, in epochs
NONE = np.empty((0, 2), dtype=np.int64)  # empty list of series of false fixes
BLOCK = 60.0  # length of the parts of a drive whose largest gains measure the misfit of the model [s]
MOVING = "offset", "drag", "followed_drag"  # kinds that displace the fixes, which may return later
FEWEST = 4  # least number of parts for quartiles
FALSE_ALARMS = 0.01  # accepted rate of false alarms of one kind, due to model errors [1/h]


class Proposal(NamedTuple):
    """Candidate faults and their predicted gain."""

    gain: float  # predicted gain, less the cost of the priors [-]
    steps: tuple[Step, ...]  # the candidate faults, as steps in the record


def score_kind(kind: Kind, score: FloatArray, information: FloatArray, interval: float) -> tuple[FloatArray, ...]:
    """Compute the largest gain of a step of one kind before each epoch, and the variance of this step, (m,) each.

    `score` (m, d), `information` (m, d, d): see `LinearRecord.project`. `interval`: between epochs [s].
    """
    variances = kind.size**2 * SIZES
    gain = gains_of(score, information, variances) - kind.cost(variances, interval)[:, None]
    gain[:, :SETTLES] = -np.inf
    return gain.max(axis=0), variances[gain.argmax(axis=0)]


def gains_of(score: FloatArray, information: FloatArray, variances: FloatArray) -> FloatArray:
    """Compute the increase of twice the log-likelihood by a step before each epoch, (k, m), for `variances` (k,).

    A single infinite variance stands for a step of free size: the increase is r' N^-1 r.
    """
    increase = np.empty((variances.size, score.shape[0]))
    if np.isfinite(variances).all():
        gains(*map(np.ascontiguousarray, (score, information)), variances, increase)
        return increase
    eigenvalues, vectors = np.linalg.eigh(information)
    square = np.einsum("mab,ma->mb", vectors, score) ** 2
    return np.asarray((square / np.maximum(eigenvalues, 1e-9 * eigenvalues[:, -1:] + 1e-30)).sum(axis=1))[None]


def misfit_of(record: LinearRecord, of: Pass, kind: Kind, beside: Sequence[int] = ()) -> float:
    """Estimate the increase r' N^-1 r that model errors of the drive cause by chance, `FALSE_ALARMS` times an hour.

    `beside`: epochs of known faults. Parts of the drive with such an epoch are not used.

    The maxima of r' N^-1 r over the parts follow a Gumbel distribution (E. J. Gumbel, "Statistics of Extremes", 1958).
    Their quartiles give two estimates of its scale. The larger one is used.
    """
    gain = gains_of(*record.project(of, kind), np.array([np.inf]))[0]
    part = np.floor((record.time - record.time[0]) / BLOCK).astype(int)
    numbers, firsts = np.unique(part, return_index=True)
    if firsts.size < FEWEST:
        return 0.0
    levels = np.array([0.25, 0.5, 0.75])
    clean = ~np.isin(numbers, part[list(beside)])
    largest = np.quantile(np.maximum.reduceat(gain, firsts)[clean if clean.sum() >= FEWEST else slice(None)], levels)
    # line through the quartiles of a Gumbel distribution, extrapolated to the rate of false alarms
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
    """Propose steps, episodes, intervals of noise, and ends of known faults, in order of decreasing gain.

    `near`: epochs at which episodes may begin or end, by default the maxima of the gain. `false` (k, 2): begin and end
    of long series of false fixes, where episodes may begin, too. `believed`: these fixes have weight one. Their errors
    then spread in the smoothed states, so only these series are tested as intervals of noise. A series up to the end of
    the record is not tested: the IMU may be wrong instead.
    """
    proposals: list[Proposal] = []
    end_cost = cost_of_end(record.interval)
    for kind in kinds:
        if record.columns(kind).shape[1] == 0:
            continue
        scores = record.project(of, kind)
        if kind.fills:
            ended = false[false[:, 1] < record.time.size]
            proposals += _interval(record, scores, kind, ended if believed and ended.size else None)
            continue
        gain_at, variance_at = score_kind(kind, *scores, record.interval)
        row = int(gain_at.argmax())
        proposals.append(Proposal(float(gain_at[row]), (Step(kind, row, float(variance_at[row])),)))
        if kind.name == "offset" and any(step.kind.name in MOVING for step in known):
            prior = float(kind.cost(variance_at[row], record.interval)) - end_cost
            proposals.append(Proposal(float(gain_at[row]) + prior, (Step(RETURN, row, 0.0),)))
        if kind.passes:
            pairs = _pairs(record, of, kind, scores, near or (*false[:, 0].tolist(), *_tops(record, gain_at)))
            for begin, end, gain, variance in sorted(pairs, key=lambda pair: -pair[2])[:2]:
                prior = float(kind.cost(variance, record.interval)) + end_cost
                proposals.append(Proposal(gain - prior, (Step(kind, begin, variance, end),)))
    for number, step in enumerate(known):
        if not step.end and step.kind.passes:
            proposals += _end(record, of, known, number, end_cost)
    return sorted((each for each in proposals if np.isfinite(each.gain)), key=lambda each: -each.gain)


def _end(record: LinearRecord, of: Pass, known: tuple[Step, ...], number: int, prior: float) -> list[Proposal]:
    """Propose the best end of a known fault that has no end. `prior`: cost of an end."""
    step = known[number]
    gain = gains_of(*record.project(of, step.kind), np.array([step.variance]))[0] - prior
    gain[: step.begin + 1] = -np.inf
    row = int(gain.argmax())
    return [Proposal(gain[row], (*known[:number], step.moved(step.begin, row), *known[number + 1 :]))]


def _pairs(
    record: LinearRecord, of: Pass, kind: Kind, seen: tuple[FloatArray, FloatArray], tops: Sequence[int]
) -> set[tuple[int, int, float, float]]:
    """Find the best episodes from the epochs `tops`: optimise end and begin in turn.

    `seen`: score and information of a step before each epoch. Returns begin, end, gain without prior, and variance.
    """
    columns, m, variances = record.columns(kind), record.time.size, kind.size**2 * SIZES
    score, information = seen
    reach, prior = max(int(REACH / record.interval), 3), kind.cost(variances, record.interval)[:, None]

    @cache
    def best_from(at: int, side: int) -> tuple[int, int, float, float] | None:
        rows = np.arange(at + SETTLES, min(at + reach, m)) if side > 0 else np.arange(max(at - reach, 1), at - 1)
        if rows.size == 0:
            return None
        cross = record.cross(of, columns, at, side * reach)[rows]
        of_pair = information[at] + information[rows] - cross - np.swapaxes(cross, 1, 2)
        gain = gains_of(side * (score[at] - score[rows]), of_pair, variances)
        size, place = np.unravel_index(int((gain - prior).argmax()), gain.shape)
        partner = int(rows[place])
        return min(at, partner), max(at, partner), float(gain[size, place]), float(variances[size])

    episodes = set[tuple[int, int, float, float]]()
    for top in tops:  # alternate between end and begin until the gain no longer increases
        at, side, best = top, 1, best_from(top, 1)
        if best is None:
            at, side, best = top, -1, best_from(top, -1)
        while best is not None:
            at, side = best[1] if side > 0 else best[0], -side
            next_best = best_from(at, side)
            if next_best is None or next_best[2] <= best[2] + 1e-6:
                episodes.add(best)
                break
            best = next_best
    return episodes


def _interval(
    record: LinearRecord, seen: tuple[FloatArray, FloatArray], kind: Kind, at: IntArray | None
) -> list[Proposal]:
    """Propose the interval of noise with the largest sum of gains over its epochs.

    `at` (k, 2): begin and end of the only allowed intervals. The sum treats the steps of all epochs as independent. It
    only selects the interval to test.
    """
    variances, proposals = kind.size**2 * SIZES, []
    for variance, gain in zip(variances, gains_of(*seen, variances), strict=True):
        total = np.concatenate([[0.0], np.cumsum(gain)])
        last = int((total - np.minimum.accumulate(total)).argmax())
        prior = float(kind.cost(variance, record.interval)) + cost_of_end(record.interval)
        for begin, end in [(int(total[: last + 1].argmin()), last)] if at is None else at.tolist():
            if end > begin + SHORTEST:
                step = Step(kind, max(begin, 1), float(variance), min(end, record.time.size - 1))
                proposals.append(Proposal(float(total[end] - total[begin]) - prior, (step,)))
    return sorted(proposals, key=lambda each: -each.gain)[:1]


def _tops(record: LinearRecord, gain: FloatArray) -> list[int]:
    """Find the epochs of the largest gains, at least `APART` seconds from each other."""
    remaining, tops = gain.copy(), []
    for _ in range(TOPS):
        row = int(remaining.argmax())
        tops.append(row)
        remaining[np.abs(record.time - record.time[row]) < APART] = -np.inf
    return tops
