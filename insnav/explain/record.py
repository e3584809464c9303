"""Linear record: error model of one filter run at its epochs, for the search of faults.

The filter runs once over the samples, with gates that reduce the weight of fixes instead of rejecting them. Its history
contains the transition of the errors between epochs, their covariance and each measurement. Errors are estimate minus
truth. To first order they follow a linear model with the noise of the run. The test of a hypothesis on faults, weights
or noise then needs one pass of covariance algebra over the epochs, without the samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insnav.explain.kinds import FADES, RETURN, Kind
from insnav.filter.error_model import MANOEUVRE, layout, reset_correlated
from insnav.filter.filter_input import FilterInput
from insnav.filter.gates import Gates
from insnav.filter.gps_noise import CorrelatedNoise
from insnav.filter.innovation_likelihood import thinned
from insnav.filter.navigate import feed
from insnav.filter.navigator import Navigator
from insnav.kernels import linear
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import STATES
from insnav.kernels.smoother import COAST, CORRECTION, JACOBIAN, KIND, NOISE, RESIDUAL, TIME
from insnav.types import BoolArray, FloatArray, ImuData, IntArray, RoundingChange

LONGEST, SHORTEST = 1024, 256  # largest and smallest number of epochs in a part of a long record
FAULTS = 9  # number of fault states: offset of positions, drift of this offset, offset of velocities
TAILS = 4.0  # degrees of freedom of Student's t distribution of fix errors and of IMU noise [-]
WEIGHTED = np.array([3.0, 3.0, NAV])  # values that share a weight: of a position, a velocity, the IMU noise of a span
LARGEST_WEIGHT = (TAILS + WEIGHTED) / (TAILS + 0.6 * WEIGHTED)  # upper limit of a weight: squares of 0.6 each [-]
# Prior sd of the logarithms of five noise figures, upwards and downwards. Three are factors on position sd, velocity sd
# and IMU noise. Two are the odds of the time-correlated share of the position variance, and its correlation time.
# Small innovations do not prove that fixes are better than stated: time-correlated errors are invisible in them. Within
# `FAR`, sds of fixes may grow by 100 (centimetres read as metres), and IMU noise by 20 (vibration).
FIGURES = (2.3, 0.03), (2.3, 0.03), (1.5, 0.8), (1.5, 1.5), (1.0, 1.0)
FAR = 2.0  # limit of a noise figure's deviation from its prior, in sd: beyond it, the model is wrong [-]
POSITION, VELOCITY, IMU, SHARE, TIME_OF_SHARE = range(5)  # indices of the noise figures
# Kinds whose end sets fault states to zero. Others end by the opposite step: after a drag, positions stay displaced
CLEARED = {"offset": linear.NO_POSITION, "rough": linear.NO_POSITION, "velocity_offset": linear.NO_VELOCITY}
NAMES = {"position": 0, "velocity": 3, "attitude": 6, "gyro": 9, "accel": 12, "delay": STATES}  # first state of each


@dataclass(frozen=True, slots=True)
class Step:
    """Fault in a record: a step of states just before an epoch and, if the fault ends, the opposite step later."""

    kind: Kind
    begin: int  # epoch before which the states step
    variance: float  # prior variance of the size along each column of the kind
    end: int = 0  # epoch before which the fault ends; 0: the fault is permanent

    def moved(self, begin: int, end: int) -> Step:
        """Move the step to other epochs."""
        return replace(self, begin=begin, end=end)


@dataclass(frozen=True, slots=True)
class Noise:
    """Logarithms of the noise figures, relative to the noise of the filter run; see `FIGURES`."""

    figures: tuple[float, ...] = (0.0,) * len(FIGURES)

    @property
    def sd(self) -> FloatArray:
        """Standard deviations of the prior in the direction of each figure, (5,) [-]."""
        return np.array([up if x > 0.0 else down for x, (up, down) in zip(self.figures, FIGURES, strict=True)])

    @property
    def cost(self) -> float:
        """Cost of the figures: -2 ln of their prior, without its constant [-]."""
        return float((np.divide(self.figures, self.sd) ** 2).sum())

    def moved(self, by: FloatArray) -> Noise:
        """Add to the figures (5,), and limit the sums to `FAR` sd of the prior."""
        up, down = FAR * np.transpose(FIGURES)
        return Noise(tuple(np.clip(self.figures + by, -down, up).tolist()))

    def tuned(self, slope: FloatArray, curve: FloatArray) -> Noise:
        """Take a step of Newton's method, from first (5,) and second (5, 5) derivatives of the cost by the figures.

        With zero curvature, damping limits the step to 0.5. A variance ten times too small needs a step of 1.2.
        """
        free = np.not_equal(self.moved(-np.sign(slope)).figures, self.figures).nonzero()[0]  # figures not at a limit
        step, damped = np.zeros(slope.size), curve + 2.0 * np.diag(np.abs(slope))
        step[free] = -np.linalg.solve(damped[free[:, None], free], slope[free])
        return self.moved(step)

    @property
    def share(self) -> float:
        """Time-correlated share of the variance of a position [-]."""
        return float(1.0 / (1.0 + np.exp(-self.figures[SHARE])))

    @property
    def time(self) -> float:
        """Correlation time of the time-correlated position error [s]."""
        return float(FADES * np.exp(self.figures[TIME_OF_SHARE]))

    def lasting(self, sd: FloatArray) -> FloatArray:
        """Compute the variance of the time-correlated position error [m^2]. `sd`: stated position sd [m]."""
        return np.asarray(self.share * np.exp(2.0 * self.figures[POSITION]) * sd**2)


def usual_correlated(position_sd: FloatArray) -> CorrelatedNoise:
    """Return typical time-correlated errors of a receiver, for position standard deviations (n, 3) [m]."""
    return CorrelatedNoise.of_fixes(Noise().share, FADES, position_sd)


@dataclass(frozen=True)
class Pass:
    """Result of one forward pass (filter) and one backward pass (smoother) over the record."""

    cost: float  # twice the negative log-likelihood of the fixes [-]
    # (m, 3) expected sums of squared residuals of position, velocity and IMU noise, over their variance at weight 1 [-]
    squares: FloatArray
    nav: FloatArray  # (m, 9) smoothed error of position, velocity and attitude
    slope: FloatArray  # (5,) derivatives of the cost by the noise figures, with their prior [-]
    inner: tuple[tuple[FloatArray, ...], ...] = field(repr=False)  # arrays of both passes, for `LinearRecord.cross`
    kept: tuple[IntArray, FloatArray, FloatArray] = field(repr=False)  # epochs of start and faults, score, information

    @cached_property
    def scores(self) -> tuple[FloatArray, ...]:
        """Score (m, n) and information (m, n, n) of a step before each epoch, from one more backward pass."""
        return run_back(self.inner, np.arange(self.nav.shape[0]), self.inner[0][2].shape[1])[:2]

    def at(self, begin: int, end: int, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return score (k, d) and information (k, d, d) along columns (n, d), at kept epochs from `begin` to `end`."""
        rows, score, information = self.kept
        selected, directions = slice(*rows.searchsorted([begin, end])), columns[: score.shape[1]]
        return score[selected] @ directions, np.asarray(directions.T @ information[selected] @ directions)

    @property
    def nav_variance(self) -> FloatArray:
        """Variance of the smoothed error of position, velocity and attitude, (m, 9)."""
        p = self.inner[2][-1][:, :NAV]
        reduction = np.einsum("mij,mij->mi", p @ self.scores[1], p)
        return np.asarray(np.maximum(np.einsum("mii->mi", p[:, :, :NAV]) - reduction, 0.0))

    def bare(self) -> Pass:
        """Copy without the large arrays."""
        return replace(self, inner=(), kept=(np.empty(0, np.int64), np.empty((0, 0)), np.empty((0, 0, 0))))

    @property
    def is_finite(self) -> bool:
        """True if all values are finite: an overflow of the backward pass reaches the first epoch."""
        return bool(np.isfinite(self.cost + self.kept[1][0] + self.kept[2][0]).all())


def run_back(inner: tuple[tuple[Any, ...], ...], rows: IntArray, n: int) -> tuple[FloatArray, ...]:
    """Run `insnav.kernels.linear.backward` for the first `n` states, and keep score and information at `rows` (k,)."""
    m, of_each = len(inner[1][0]), (np.empty((rows.size, n)), np.empty((rows.size, n, n)))
    results = *of_each, np.empty((m, 6)), np.empty((m, 6)), np.empty((m, 4, inner[2][3].size)), np.empty(m)
    linear.backward(*inner, rows, *results)
    return results


@dataclass(frozen=True, slots=True)
class LinearRecord:
    """Linear error model of one filter run at its epochs."""

    time: FloatArray  # (m,) times of the epochs, on the clock of the samples [s]
    interval: float  # usual time between epochs [s]
    system: tuple[FloatArray, ...]  # spans, transitions, fading, noise; see `insnav.kernels.linear`
    measured: tuple[FloatArray, ...]  # predicted minus measured, derivatives, corrections of the state
    variance: FloatArray  # (m, 6) of the white noise of the fixes, 0 without a measurement
    start: FloatArray  # (n, n) initial covariance without the time-correlated error
    states: dict[str, int]  # index of the first state of each group, by name
    correlated_sd: FloatArray  # (3,) standard deviation of a position, including its time-correlated share [m]
    from_fix: bool  # the first position comes from a fix and has its time-correlated error

    @classmethod
    def of(cls, ready: FilterInput) -> Iterator[LinearRecord]:
        """Run the filter over the longest part of a recording, and yield records of up to `LONGEST` epochs each.

        Each record is built when needed. To save memory, the caller should keep one at a time.

        Raises: DivergenceError: the filter lost consistency.
        """
        ready = ready.longest_part()
        gates = ready.gates
        soft = Gates(gates.max_sd, np.inf, np.inf, gates.probability, np.inf, np.inf, np.inf)
        # misalignments are states here, not noise as in the filter
        model = replace(ready.model, noise=np.append(ready.model.noise[:-2], [0.0, 0.0]))
        used = ready.replace_correlated(usual_correlated(ready.gps.position_sd)).keep_history()
        navigator = Navigator(replace(used, model=model, gps=thinned(ready.gps), gates=soft))
        history = feed(navigator, ready.imu).history().blocks()
        blocks = [part for each in history for part in np.array_split(each, -(-len(each) // LONGEST))]
        if len(blocks) > 1 and len(blocks[-1]) < SHORTEST:
            blocks[-2:] = [np.concatenate(blocks[-2:])]
        sd = np.sqrt(ready.model.noise[-2:] / MANOEUVRE)
        starts = [ready.initial.from_fix, *[False] * (len(blocks) - 1)]
        records = (cls._from_history(*each, replace(used, gps=ready.gps)) for each in zip(blocks, starts, strict=True))
        return (record.with_axes(ready.imu, sd).with_rounding(ready.rounding) for record in records)

    @classmethod
    def _from_history(cls, history: FloatArray, from_fix: bool, ready: FilterInput) -> LinearRecord:
        """Build a record from the history of a run: transitions, noise, measurements and corrections of the state."""
        index, gps, m = layout(ready.receiver), ready.gps, history.shape[0]
        n, time = index.states, history[:, TIME].copy()
        span = np.diff(time, prepend=time[:1])
        jacobian, transition, lower = np.split(history[:, JACOBIAN:], [6 * n, -n * (n + 1) // 2], axis=1)
        before = np.empty((m, n, n))
        rows, columns = np.tril_indices(n)
        before[:, rows, columns] = before[:, columns, rows] = lower
        phi, fade = transition[:, : NAV * STATES].reshape(m, NAV, STATES).copy(), np.ones((m, n + FAULTS))
        fade[1:, NAV:n] = transition[1:, NAV * STATES :]
        used = (history[:, KIND, None].astype(int) >> np.arange(6) & 1 > 0) & (history[:, KIND, None] > COAST)
        h = np.where(used[:, :, None], jacobian.reshape(m, 6, n), 0.0)
        z = np.where(used, history[:, RESIDUAL : RESIDUAL + 6], 0.0)
        hp, both = h @ before, used[:, :, None] & used[:, None]
        s = hp @ np.swapaxes(h, 1, 2) + np.where(both, history[:, NOISE : NOISE + 36].reshape(m, 6, 6), np.eye(6))
        gain = np.linalg.solve(s, hp)
        after = np.roll(before - np.swapaxes(hp, 1, 2) @ gain, 1, axis=0)  # covariance after previous update
        # noise of a span between epochs: its predicted covariance minus the propagated covariance
        q = before[:, :NAV, :NAV] - phi @ after[:, :STATES, :STATES] @ np.swapaxes(phi, 1, 2)
        variance_before, variance_after = (np.diagonal(each, axis1=1, axis2=2)[:, NAV:] for each in (before, after))
        qd = np.zeros((m, n + FAULTS))
        qd[1:, NAV:n] = np.maximum(variance_before - fade[:, NAV:n] ** 2 * variance_after, 0.0)[1:]
        # remove negative eigenvalues, which are rounding errors
        values, vectors = np.linalg.eigh(0.5 * (q + np.swapaxes(q, 1, 2)))
        q = (vectors * np.maximum(values, 0.0)[:, None]) @ np.swapaxes(vectors, 1, 2)
        q[0] = 0.0
        states = NAMES | {"correlated": index.correlated, "offset": n, "drift": n + 3, "velocity offset": n + 6}
        unseen = {"delay": index.delay < 0, "velocity offset": not used[:, 3:].any()}  # states without effect
        states = {name: first for name, first in states.items() if not unseen.get(name)}
        # an offset state adds to measured positions, a velocity offset to measured velocities
        of_faults = np.zeros((m, 6, FAULTS))
        of_faults[:, range(3), range(3)] = of_faults[:, range(3, 6), range(6, 9)] = -1.0
        h = np.concatenate([h, np.where(used[:, :, None], of_faults, 0.0)], axis=2)
        fed = np.zeros((m, n + FAULTS))
        fed[:, :n] = np.einsum("mi,mij->mj", z, gain)
        sensors, taken = history[:, CORRECTION : CORRECTION + STATES - NAV], np.zeros((m + 1, NAV))
        for change in ready.explained.changes:
            if change.first < NAV:
                taken[np.searchsorted(time, change.time - 1e-6), change.first : change.first + 3] += change.change
        at_change = [change.time for change in ready.explained.changes] + [change.time for change in ready.rounding]
        for k in np.unique(np.searchsorted(time, np.array(at_change) - 1e-6)):
            if 0 < k < m:  # the run subtracted the change here: add it to the corrections
                q[k], qd[k], fade[k, NAV:STATES] = q[k - 1], qd[k - 1], fade[k - 1, NAV:STATES]
                correction = np.zeros(STATES)
                correction[NAV:] = sensors[k - 1] - (sensors[k] + fed[k, NAV:STATES]) / fade[k, NAV:STATES]
                correction[:NAV] = np.linalg.solve(phi[k, :, :NAV], taken[k] - phi[k, :, NAV:] @ correction[NAV:])
                fed[k - 1, :STATES] += correction
        row = np.minimum(np.searchsorted(ready.fix_time, time - 1e-4), gps.time.size - 1)
        sd = np.hstack([gps.position_sd[row], gps.velocity_sd[row]])
        # jitter of the timestamps times the derivative by the delay (speed, acceleration) is noise
        jitter = ready.receiver.jitter * h[:, :, STATES] if index.delay >= 0 else 0.0
        start = np.zeros((n + FAULTS, n + FAULTS))
        start[:n, :n] = before[0]
        reset_correlated(start, index.correlated, np.zeros(3))
        start[range(3), range(3)] -= from_fix * usual_correlated(gps.position_sd).sds ** 2
        variance = np.where(used, np.nan_to_num(sd) ** 2 + jitter**2, 0.0)
        return cls(
            *(time, float(np.median(np.diff(time))), (span, phi, fade, q, qd), (z, h, fed), variance, start, states),
            correlated_sd=np.median(gps.position_sd, axis=0),
            from_fix=from_fix,
        )

    def with_axes(self, imu: ImuData, sd: FloatArray) -> LinearRecord:
        """Add the twelve misalignments of the sensors as constant states, after the sensor errors.

        A misalignment makes one axis sense a part of the mean rate or specific force of another axis. `sd` (2,): of
        gyros and accelerometers [rad].
        """
        rows = slice(*np.searchsorted(imu.time, [self.time[0] - 1.0, self.time[-1] + 1.0]))
        imu = imu.rows(rows)
        step = np.ones(1) if imu.sampling == "increment" else np.gradient(imu.time)[:, None]
        sums = np.cumsum(np.hstack([imu.gyro, imu.accel]) * step, axis=0)
        sums = np.stack([np.interp(self.time, imu.time, column) for column in sums.T], axis=1)
        span, phi, *_ = self.system
        mean = np.diff(sums, axis=0, prepend=sums[:1]) / np.maximum(span, 1e-9)[:, None]
        pairs = [(i, j) for i in range(6) for j in range(i // 3 * 3, i // 3 * 3 + 3) if i != j]
        effect = np.stack([phi[:, :, NAV + i] * mean[:, j, None] for i, j in pairs], axis=2)
        return self._with_states(effect, np.repeat(sd**2, len(pairs) // 2))

    def with_rounding(self, rounding: Sequence[RoundingChange]) -> LinearRecord:
        """Add rounding errors of coarse gyros as states, apart from the bias; each change makes them independent."""
        if not rounding:
            return self
        gyros, added = slice(NAV, NAV + 3), slice(STATES, STATES + 3)
        record = self._with_states(self.system[1][:, :, gyros], np.zeros(3))
        (_, _, fade, _, qd), start, first = record.system, record.start, np.full(3, np.nan)
        for each, k in zip(rounding, np.searchsorted(self.time, [each.time - 1e-6 for each in rounding]), strict=True):
            changed = ~np.isnan(each.after)
            if k == 0:
                first[changed] = each.after[changed]
                continue
            first = np.where(np.isnan(first), each.before, first)
            if k < self.time.size:
                fade[k, added][changed], qd[k, added][changed] = 0.0, each.after[changed]
        variance = np.diag(np.nan_to_num(first))  # the run knows the sum of bias and rounding error
        start[gyros, gyros] += variance
        start[added, added] = variance
        start[gyros, added] = start[added, gyros] = -variance
        return record

    def _with_states(self, by: FloatArray, variance: FloatArray) -> LinearRecord:
        """Insert constant states of `variance` (k,). `by` (m, 9, k): their effect on navigation errors in each span."""
        (span, phi, fade, q, qd), (z, h, fed), added = self.system, self.measured, [STATES] * variance.size
        fade = np.insert(fade, added, 1.0, axis=1)
        qd, h, fed, start = (np.insert(each, added, 0.0, axis=-1) for each in (qd, h, fed, self.start))
        start, phi = np.insert(start, added, 0.0, axis=0), np.dstack([phi[:, :, :STATES], by, phi[:, :, STATES:]])
        inserted = np.arange(STATES, STATES + variance.size)
        start[inserted, inserted] = variance
        states = {name: first + inserted.size * (first >= STATES) for name, first in self.states.items()}
        system = span, np.ascontiguousarray(phi), fade, q, qd
        return replace(self, system=system, measured=(z, h, fed), start=start, states=states)

    def until(self, count: int) -> LinearRecord:
        """Copy the first `count` epochs."""
        system, measured = (tuple(each[:count] for each in group) for group in (self.system, self.measured))
        variance = self.variance[:count]
        return replace(self, time=self.time[:count], system=system, measured=measured, variance=variance)

    def span_of(self, step: Step) -> tuple[float, float]:
        """Return begin and end of a fault [s]; the end of a permanent fault is infinite."""
        return float(self.time[step.begin]), float(self.time[step.end]) if step.end else np.inf

    @property
    def lasting(self) -> FloatArray:
        """Effect of the time-correlated error on the initial states, (3, n): a position set to a fix has it, too."""
        n = self.start.shape[0]
        return np.asarray(np.eye(3, n, self.states["correlated"]) - self.from_fix * np.eye(3, n))

    @property
    def known(self) -> BoolArray:
        """Availability of a measured position and velocity at each epoch, (m, 2)."""
        return np.asarray(self.variance[:, ::3] > 0.0)

    def project(self, of: Pass, kind: Kind) -> tuple[FloatArray, FloatArray]:
        """Compute score (m, d) and information (m, d, d) of a step of one kind before each epoch."""
        columns = self.columns(kind)
        rows = np.flatnonzero(columns.any(axis=1))
        selection, score, information = columns[rows], of.scores[0][:, rows], of.scores[1][:, rows[:, None], rows]
        if np.array_equal(selection, np.eye(rows.size)):  # each column is one state: skip the products
            return score, information
        return score @ selection, np.asarray(selection.T @ information @ selection)

    def columns(self, kind: Kind) -> FloatArray:
        """Build the columns of a kind, (n, d), with ones at the states that step; (n, 0) without such a state."""
        matrix = np.zeros((self.start.shape[0], len(kind.steps)))
        for column, names in enumerate(kind.steps):
            for name, axis in (each.rsplit(" ", 1) for each in names):
                if name not in self.states:
                    return matrix[:, :0]
                matrix[self.states[name] + int(axis), column] = 1.0
        return matrix

    def run(self, steps: tuple[Step, ...], weights: FloatArray, noise: Noise) -> Pass:
        """Compute likelihood, scores and residuals for given faults, noise and weights (m, 3); see `WEIGHTED`."""
        system, jumps, start = self._with(steps, noise)
        factor = np.exp(2.0 * np.array(noise.figures[:IMU])) * [1.0 - noise.share, 1.0]
        z, h, fed = self.measured
        measured = z, h, self.variance * np.repeat(factor / weights[:, :2], 3, axis=1), fed
        system = *system[:3], system[3] / weights[:, 2, None, None], *system[4:]
        m, n, lasting = self.time.size, self.start.shape[0], self.states["correlated"]
        rows = np.array([*range(NAV), lasting, lasting + 1, lasting + 2])
        out = np.empty((m, 6)), np.empty((m, 6)), np.empty((m, 6, n)), rows, np.empty((m, 12)), np.empty((m, 12, n))
        cost: float = linear.forward(system, measured, (np.zeros(n), start), jumps, out)
        spans = (range(step.begin, step.end if step.kind.fills else step.begin + 1) for step in steps)
        rows = np.array(sorted({0, *chain(*spans)}))
        active = n if jumps[1][:, -FAULTS:].any() else n - FAULTS  # without faults of fixes, fault states stay zero
        variance, inner = measured[2], (system, measured, out)
        score, information, u, uu, smoothed, driven = run_back(inner, rows, active)
        # the derivative of the cost by a log variance is the number of values minus their expected squares
        white = np.where(variance > 0.0, variance * (uu - u**2), 0.0).reshape(m, 2, 3).sum(axis=2)
        slopes = np.column_stack([white, driven])  # derivatives of the cost by log variances of position, velocity, IMU
        counts = np.column_stack([(variance > 0.0).reshape(m, 2, 3).sum(axis=2), np.full(m, NAV)])
        first, kept = information[0] - np.outer(score[0], score[0]), (rows, score, information)
        slope = self._slope(noise, slopes.sum(axis=0), first, smoothed[:, :, NAV:])
        return Pass(cost, (counts - slopes) / weights, smoothed[:, 0, :NAV].copy(), slope, inner, kept)

    def _slope(self, noise: Noise, by_blocks: FloatArray, first: FloatArray, told: FloatArray) -> FloatArray:
        """Compute derivatives of the cost by the noise figures (5,), including their prior.

        `by_blocks` (3,): derivatives by the logarithms of the variances of positions, velocities and IMU. `first`:
        information minus squared score at the start. `told` (m, 4, 3): smoothed time-correlated errors, see
        `insnav.kernels.linear.backward`.
        Source: S. J. Koopman, N. Shephard, "Exact score for time series models in state space form", Biometrika 79
        (1992) 823-826.
        """
        share, rate, lasting = noise.share, self.system[0] / noise.time, noise.lasting(self.correlated_sd)
        error, score, product, information = np.swapaxes(told, 0, 1)
        product, information, by = product - score * error, information - score**2, self.lasting[:, : first.shape[0]]
        size = (-np.expm1(-2.0 * rate) @ information + np.einsum("in,nk,ik->i", by, first, by)) @ lasting
        time = 2.0 * rate @ (product - lasting * information).sum(axis=1)
        position, velocity, imu = 2.0 * by_blocks
        slopes = position + 2.0 * size, velocity, imu, (1.0 - share) * size - share * by_blocks[0], time
        return np.asarray(slopes + 2.0 * np.divide(noise.figures, noise.sd**2))

    def cross(self, of: Pass, columns: FloatArray, at: int, reach: int) -> FloatArray:
        """Compute the cross information between a step before epoch `at` and a step before each other epoch, (m, d, d).

        `reach`: number of later epochs, or of earlier epochs if negative. Beyond it, the result is zero.
        """
        last = int(np.clip(at + reach, 0, self.time.size - 1))
        return np.asarray(linear.cross(*of.inner, of.scores[1], at, columns, last))

    def _with(
        self, steps: tuple[Step, ...], noise: Noise
    ) -> tuple[tuple[NDArray[Any], ...], tuple[NDArray[Any], ...], FloatArray]:
        """Apply noise and faults: return the system, covariance increases with their epochs, and first covariance."""
        span, phi, fade, q, qd = self.system
        by, i, lasting = np.exp(2.0 * noise.figures[IMU]), self.states["correlated"], noise.lasting(self.correlated_sd)
        fade, qd, start = fade.copy(), qd.copy(), self.start + self.lasting.T * lasting @ self.lasting
        decay = np.exp(-span / noise.time)[:, None]
        fade[:, i : i + 3], qd[:, i : i + 3] = decay, (1.0 - decay**2) * lasting
        cleared: IntArray = np.zeros(span.size, dtype=np.int64)
        increases: list[tuple[int, FloatArray]] = []
        first = self.states["offset"]
        for step in steps:
            if step.kind is RETURN:
                cleared[step.begin] |= linear.NO_POSITION | linear.NO_VELOCITY
                continue
            columns = np.sqrt(step.variance) * self.columns(step.kind)
            g = np.zeros((columns.shape[0], 3))
            g[:, : columns.shape[1]] = columns
            if step.kind.fills:
                inside = slice(step.begin, step.end)
                fade[inside, first : first + 3] = np.exp(-span[inside, None] / FADES)
                increases += [(k, g) for k in range(step.begin, step.end)]
            else:
                increases.append((step.begin, g))
            if step.end and step.kind.name in CLEARED:
                cleared[step.end] |= CLEARED[step.kind.name]
            elif step.end:
                increases.append((step.end, g))
        increases.sort(key=lambda each: each[0])
        rows = np.array([row for row, _ in increases], dtype=np.int64)
        jumps = rows, np.array([g for _, g in increases]).reshape(rows.size, self.start.shape[0], 3)
        return (span, phi, fade, by * q, qd, cleared), jumps, start
