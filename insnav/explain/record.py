"""Linear record: error model of one filter run at its epochs, for the search of faults.

The filter runs once over the samples, with gates that reduce the weight of fixes instead of rejecting them. Its history
contains the transition of the errors between epochs, their covariance and each measurement. Errors are estimate minus
truth. To first order they follow a linear model with the noise of the run. A test of faults, weights or noise then
costs one pass of covariance algebra over the epochs, without the samples.
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
FAULTS = 9  # states of faults: offset of positions, its drift, offset of velocities
TAILS = 4.0  # degrees of freedom of the errors of fixes and of the noise of the IMU, Student's t [-]
WEIGHTED = np.array([3.0, 3.0, NAV])  # number of values with a common weight: position, velocity, noise of a span [-]
LEAST = (TAILS + WEIGHTED) / (TAILS + 0.6 * WEIGHTED)  # largest weight, for values with squares of 0.6 each [-]
# Prior sd of the logarithms of five noise figures, upwards and downwards. Three are factors on position sd, velocity sd
# and IMU noise. Two are the odds of the time-correlated share of the position variance, and its correlation time.
# Innovations cannot show that fixes are better than stated, as lasting errors are invisible in them. With `FAR`, a
# factor of 100 is possible, as of centimetres taken for metres. For the IMU it is 20: vibration adds much noise.
FIGURES = (2.3, 0.03), (2.3, 0.03), (1.5, 0.8), (1.5, 1.5), (1.0, 1.0)
FAR = 2.0  # largest deviation of a noise figure, in sd of its prior: beyond, the model is wrong [-]
POSITION, VELOCITY, IMU, SHARE, TIME_OF_SHARE = range(5)
# states cleared at the end of a fault; other kinds end by a step back, and positions stay displaced after a drag
CLEARED = {"offset": linear.NO_POSITION, "rough": linear.NO_POSITION, "velocity_offset": linear.NO_VELOCITY}
NAMES = {"position": 0, "velocity": 3, "attitude": 6, "gyro": 9, "accel": 12, "delay": STATES}


@dataclass(frozen=True, slots=True)
class Step:
    """Fault in a record: a step of states just before an epoch, and perhaps the opposite step later."""

    kind: Kind
    begin: int  # epoch
    variance: float  # of its size, in each column
    end: int = 0  # epoch of the opposite step; 0: the fault stays

    def moved(self, begin: int, end: int) -> Step:
        """Move the step to other epochs."""
        return replace(self, begin=begin, end=end)


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise figures as logarithms, relative to the noise of the run; see `FIGURES`."""

    figures: tuple[float, ...] = (0.0,) * len(FIGURES)

    @property
    def sd(self) -> FloatArray:
        """Standard deviations of the prior in the direction of each figure, (5,) [-]."""
        return np.array([up if x > 0.0 else down for x, (up, down) in zip(self.figures, FIGURES, strict=True)])

    @property
    def cost(self) -> float:
        """Value of -2 ln of their prior [-]."""
        return float((np.divide(self.figures, self.sd) ** 2).sum())

    def moved(self, by: FloatArray) -> Noise:
        """Change the figures (5,), within `FAR`."""
        up, down = FAR * np.transpose(FIGURES)
        return Noise(tuple(np.clip(self.figures + by, -down, up).tolist()))

    def tuned(self, slope: FloatArray, curve: FloatArray) -> Noise:
        """Take a step of Newton's method, with the derivatives of the cost (5,) and their derivatives (5, 5).

        Without curvature, the damping allows half a unit: that far, a variance ten times too small decreases the cost.
        """
        free = np.not_equal(self.moved(-np.sign(slope)).figures, self.figures).nonzero()[0]  # not at a limit
        step, damped = np.zeros(slope.size), curve + 2.0 * np.diag(np.abs(slope))
        step[free] = -np.linalg.solve(damped[free[:, None], free], slope[free])
        return self.moved(step)

    @property
    def share(self) -> float:
        """Time-correlated share of the variance of a position [-]."""
        return float(1.0 / (1.0 + np.exp(-self.figures[SHARE])))

    @property
    def time(self) -> float:
        """Correlation time of that share [s]."""
        return float(FADES * np.exp(self.figures[TIME_OF_SHARE]))

    def lasting(self, sd: FloatArray) -> FloatArray:
        """Compute the variance of the time-correlated position error [m^2]. `sd`: stated position sd [m]."""
        return np.asarray(self.share * np.exp(2.0 * self.figures[POSITION]) * sd**2)


def usual_correlated(position_sd: FloatArray) -> CorrelatedNoise:
    """Return typical time-correlated errors of a receiver, for position standard deviations (n, 3) [m]."""
    return CorrelatedNoise.of_fixes(Noise().share, FADES, position_sd)


@dataclass(frozen=True)
class Pass:
    """Result of a forward and a backward pass over the record."""

    cost: float  # twice the negative log-likelihood of the fixes [-]
    # (m, 3) expected sums of squares of position residuals, velocity residuals and IMU noise, in variances at weight 1
    squares: FloatArray
    nav: FloatArray  # (m, 9) smoothed error of position, velocity and attitude
    slope: FloatArray  # (5,) derivatives of the cost by the noise figures, with their prior [-]
    inner: tuple[tuple[FloatArray, ...], ...] = field(repr=False)  # of the passes, for `LinearRecord.cross`
    kept: tuple[IntArray, FloatArray, FloatArray] = field(repr=False)  # start and faults: epoch, score, information

    @cached_property
    def scores(self) -> tuple[FloatArray, ...]:
        """Score (m, n) and information (m, n, n) of a step before each epoch. Few passes need this backward pass."""
        return run_back(self.inner, np.arange(self.nav.shape[0]), self.inner[0][2].shape[1])[:2]

    def at(self, begin: int, end: int, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return score (k, d) and information (k, d, d) along columns (n, d) from the begin of a fault to its end."""
        rows, score, information = self.kept
        here, by = slice(*rows.searchsorted([begin, end])), columns[: score.shape[1]]
        return score[here] @ by, np.asarray(by.T @ information[here] @ by)

    @property
    def nav_variance(self) -> FloatArray:
        """Variance of the smoothed error of position, velocity and attitude, (m, 9)."""
        p = self.inner[2][-1][:, :NAV]
        told = np.einsum("mij,mij->mi", p @ self.scores[1], p)
        return np.asarray(np.maximum(np.einsum("mii->mi", p[:, :, :NAV]) - told, 0.0))

    def bare(self) -> Pass:
        """Drop the large arrays."""
        return replace(self, inner=(), kept=(np.empty(0, np.int64), np.empty((0, 0)), np.empty((0, 0, 0))))

    @property
    def is_finite(self) -> bool:
        """True if all values are finite: an overflow of the backward pass reaches the first epoch."""
        return bool(np.isfinite(self.cost + self.kept[1][0] + self.kept[2][0]).all())


def run_back(inner: tuple[tuple[Any, ...], ...], rows: IntArray, n: int) -> tuple[FloatArray, ...]:
    """Fill the results of `insnav.kernels.linear.backward` for the first `n` states, kept at epochs `rows` (k,)."""
    m, of_each = len(inner[1][0]), (np.empty((rows.size, n)), np.empty((rows.size, n, n)))
    found = *of_each, np.empty((m, 6)), np.empty((m, 6)), np.empty((m, 4, inner[2][3].size)), np.empty(m)
    linear.backward(*inner, rows, *found)
    return found


@dataclass(frozen=True, slots=True)
class LinearRecord:
    """Linear error model of one run at its epochs."""

    time: FloatArray  # (m,) epochs in sample time [s]
    interval: float  # usual time between epochs [s]
    system: tuple[FloatArray, ...]  # spans, transitions, fading, noise; see `insnav.kernels.linear`
    measured: tuple[FloatArray, ...]  # predicted minus measured, derivatives, corrections of the state
    variance: FloatArray  # (m, 6) of the white noise of the fixes, 0 without a measurement
    start: FloatArray  # (n, n) covariance without the time-correlated error
    states: dict[str, int]  # first index, by name
    correlated_sd: FloatArray  # (3,) standard deviation of a position, including its time-correlated share [m]
    from_fix: bool  # the first position comes from a fix and has its time-correlated error

    @classmethod
    def of(cls, ready: FilterInput) -> Iterator[LinearRecord]:
        """Run the filter over the longest part of a recording, and divide its epochs into parts of bounded length.

        The caller should keep one part at a time.

        Raises: DivergenceError: the filter lost consistency.
        """
        ready = ready.longest_part()
        gates = ready.gates
        soft = Gates(gates.max_sd, np.inf, np.inf, gates.probability, np.inf, np.inf, np.inf)
        # misalignments are states here, not noise as in the filter
        model = replace(ready.model, noise=np.append(ready.model.noise[:-2], [0.0, 0.0]))
        used = ready.replace_correlated(usual_correlated(ready.gps.position_sd)).keep_history()
        navigator = Navigator(replace(used, model=model, gps=thinned(ready.gps), gates=soft))
        whole = feed(navigator, ready.imu).history().blocks()
        blocks = [part for each in whole for part in np.array_split(each, -(-len(each) // LONGEST))]
        if len(blocks) > 1 and len(blocks[-1]) < SHORTEST:
            blocks[-2:] = [np.concatenate(blocks[-2:])]
        sd = np.sqrt(ready.model.noise[-2:] / MANOEUVRE)
        first = [ready.initial.from_fix, *[False] * (len(blocks) - 1)]
        records = (cls._from_history(*each, replace(used, gps=ready.gps)) for each in zip(blocks, first, strict=True))
        return (record.with_axes(ready.imu, sd).with_rounding(ready.rounding) for record in records)

    @classmethod
    def _from_history(cls, history: FloatArray, from_fix: bool, ready: FilterInput) -> LinearRecord:
        """Build a record from the history of a run: transitions, noise, measurements and state corrections."""
        at, gps, m = layout(ready.receiver), ready.gps, history.shape[0]
        n, time = at.states, history[:, TIME].copy()
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
        after = np.roll(before - np.swapaxes(hp, 1, 2) @ gain, 1, axis=0)  # the epoch before
        # noise of a span: predicted covariance minus the propagated covariance
        q = before[:, :NAV, :NAV] - phi @ after[:, :STATES, :STATES] @ np.swapaxes(phi, 1, 2)
        own, old = (np.diagonal(each, axis1=1, axis2=2)[:, NAV:] for each in (before, after))
        qd = np.zeros((m, n + FAULTS))
        qd[1:, NAV:n] = np.maximum(own - fade[:, NAV:n] ** 2 * old, 0.0)[1:]
        values, vectors = np.linalg.eigh(0.5 * (q + np.swapaxes(q, 1, 2)))
        q = (vectors * np.maximum(values, 0.0)[:, None]) @ np.swapaxes(vectors, 1, 2)
        q[0] = 0.0
        states = NAMES | {"correlated": at.correlated, "offset": n, "drift": n + 3, "velocity offset": n + 6}
        unseen = {"delay": at.delay < 0, "velocity offset": not used[:, 3:].any()}  # no effect, no search
        states = {name: first for name, first in states.items() if not unseen.get(name)}
        of_faults = np.zeros((m, 6, FAULTS))
        of_faults[:, range(3), range(3)] = of_faults[:, range(3, 6), range(6, 9)] = -1.0
        h = np.concatenate([h, np.where(used[:, :, None], of_faults, 0.0)], axis=2)
        fed = np.zeros((m, n + FAULTS))
        fed[:, :n] = np.einsum("mi,mij->mj", z, gain)
        sensors, taken = history[:, CORRECTION : CORRECTION + STATES - NAV], np.zeros((m + 1, NAV))
        for each in ready.explained.changes:
            if each.first < NAV:
                taken[np.searchsorted(time, each.time - 1e-6), each.first : each.first + 3] += each.change
        at_change = [each.time for each in ready.explained.changes] + [each.time for each in ready.rounding]
        for of in np.unique(np.searchsorted(time, np.array(at_change) - 1e-6)):
            if 0 < of < m:  # as the run took it off its state
                q[of], qd[of], fade[of, NAV:STATES] = q[of - 1], qd[of - 1], fade[of - 1, NAV:STATES]
                part = np.zeros(STATES)
                part[NAV:] = sensors[of - 1] - (sensors[of] + fed[of, NAV:STATES]) / fade[of, NAV:STATES]
                part[:NAV] = np.linalg.solve(phi[of, :, :NAV], taken[of] - phi[of, :, NAV:] @ part[NAV:])
                fed[of - 1, :STATES] += part
        row = np.minimum(np.searchsorted(ready.fix_time, time - 1e-4), gps.time.size - 1)
        sd = np.hstack([gps.position_sd[row], gps.velocity_sd[row]])
        # timestamps that scatter add speed and acceleration, the derivative by the delay
        jitter = ready.receiver.jitter * h[:, :, STATES] if at.delay >= 0 else 0.0
        start = np.zeros((n + FAULTS, n + FAULTS))
        start[:n, :n] = before[0]
        reset_correlated(start, at.correlated, np.zeros(3))
        start[range(3), range(3)] -= from_fix * usual_correlated(gps.position_sd).sds ** 2
        variance = np.where(used, np.nan_to_num(sd) ** 2 + jitter**2, 0.0)
        return cls(
            *(time, float(np.median(np.diff(time))), (span, phi, fade, q, qd), (z, h, fed), variance, start, states),
            correlated_sd=np.median(gps.position_sd, axis=0),
            from_fix=from_fix,
        )

    def with_axes(self, imu: ImuData, sd: FloatArray) -> LinearRecord:
        """Add misalignments of the sensors as constant states, after the sensor errors.

        Each acts on its axis by the mean rate or specific force of another axis. `sd`: (2,) of gyros and accelerometers
        [rad].
        """
        rows = slice(*np.searchsorted(imu.time, [self.time[0] - 1.0, self.time[-1] + 1.0]))
        imu = imu.rows(rows)
        step = np.ones(1) if imu.sampling == "increment" else np.gradient(imu.time)[:, None]
        sums = np.cumsum(np.hstack([imu.gyro, imu.accel]) * step, axis=0)
        sums = np.stack([np.interp(self.time, imu.time, column) for column in sums.T], axis=1)
        span, phi, *_ = self.system
        mean = np.diff(sums, axis=0, prepend=sums[:1]) / np.maximum(span, 1e-9)[:, None]
        pairs = [(i, j) for i in range(6) for j in range(i // 3 * 3, i // 3 * 3 + 3) if i != j]
        by = np.stack([phi[:, :, NAV + i] * mean[:, j, None] for i, j in pairs], axis=2)
        return self._with_states(by, np.repeat(sd**2, len(pairs) // 2))

    def with_rounding(self, rounding: Sequence[RoundingChange]) -> LinearRecord:
        """Separate rounding errors of coarse gyros from the bias. After each change they are independent."""
        if not rounding:
            return self
        gyros, own = slice(NAV, NAV + 3), slice(STATES, STATES + 3)
        record = self._with_states(self.system[1][:, :, gyros], np.zeros(3))
        (_, _, fade, _, qd), start, first = record.system, record.start, np.full(3, np.nan)
        for each, of in zip(rounding, np.searchsorted(self.time, [each.time - 1e-6 for each in rounding]), strict=True):
            new = ~np.isnan(each.after)
            if of == 0:
                first[new] = each.after[new]
                continue
            first = np.where(np.isnan(first), each.before, first)
            if of < self.time.size:
                fade[of, own][new], qd[of, own][new] = 0.0, each.after[new]
        unknown = np.diag(np.nan_to_num(first))  # the run estimates bias and rounding error together
        start[gyros, gyros] += unknown
        start[own, own] = unknown
        start[gyros, own] = start[own, gyros] = -unknown
        return record

    def _with_states(self, by: FloatArray, variance: FloatArray) -> LinearRecord:
        """Insert constant states after the sensor errors. `by` (m, 9, k): effect on each span. `variance` (k,)."""
        (span, phi, fade, q, qd), (z, h, fed), added = self.system, self.measured, [STATES] * variance.size
        fade = np.insert(fade, added, 1.0, axis=1)
        qd, h, fed, start = (np.insert(each, added, 0.0, axis=-1) for each in (qd, h, fed, self.start))
        start, phi = np.insert(start, added, 0.0, axis=0), np.dstack([phi[:, :, :STATES], by, phi[:, :, STATES:]])
        own = np.arange(STATES, STATES + variance.size)
        start[own, own] = variance
        states = {name: first + own.size * (first >= STATES) for name, first in self.states.items()}
        system = span, np.ascontiguousarray(phi), fade, q, qd
        return replace(self, system=system, measured=(z, h, fed), start=start, states=states)

    def until(self, count: int) -> LinearRecord:
        """Select the first epochs."""
        system, measured = (tuple(each[:count] for each in group) for group in (self.system, self.measured))
        variance = self.variance[:count]
        return replace(self, time=self.time[:count], system=system, measured=measured, variance=variance)

    def span_of(self, step: Step) -> tuple[float, float]:
        """Return the times of begin and end of a fault, infinity for one that stays [s]."""
        return float(self.time[step.begin]), float(self.time[step.end]) if step.end else np.inf

    @property
    def lasting(self) -> FloatArray:
        """Effect of the time-correlated error on the states at the start, (3, n): a first position has it, too."""
        n = self.start.shape[0]
        return np.asarray(np.eye(3, n, self.states["correlated"]) - self.from_fix * np.eye(3, n))

    @property
    def known(self) -> BoolArray:
        """Availability of position and velocity at each epoch, (m, 2)."""
        return np.asarray(self.variance[:, ::3] > 0.0)

    def project(self, of: Pass, kind: Kind) -> tuple[FloatArray, FloatArray]:
        """Compute score (m, d) and information (m, d, d) of a step of one kind before each epoch."""
        columns = self.columns(kind)
        rows = np.flatnonzero(columns.any(axis=1))
        by, score, information = columns[rows], of.scores[0][:, rows], of.scores[1][:, rows[:, None], rows]
        if np.array_equal(by, np.eye(rows.size)):  # each column is a state: no products of small matrices
            return score, information
        return score @ by, np.asarray(by.T @ information @ by)

    def columns(self, kind: Kind) -> FloatArray:
        """Build the effect of each column of a kind on the states, (n, d); (n, 0) if the record lacks the states."""
        found = np.zeros((self.start.shape[0], len(kind.steps)))
        for column, names in enumerate(kind.steps):
            for name, axis in (each.rsplit(" ", 1) for each in names):
                if name not in self.states:
                    return found[:, :0]
                found[self.states[name] + int(axis), column] = 1.0
        return found

    def run(self, steps: tuple[Step, ...], weights: FloatArray, noise: Noise) -> Pass:
        """Compute likelihood, scores and residuals with faults, weights (m, 3) and noise; see `WEIGHTED`."""
        system, jumps, start = self._with(steps, noise)
        by = np.exp(2.0 * np.array(noise.figures[:IMU])) * [1.0 - noise.share, 1.0]
        z, h, fed = self.measured
        measured = z, h, self.variance * np.repeat(by / weights[:, :2], 3, axis=1), fed
        system = *system[:3], system[3] / weights[:, 2, None, None], *system[4:]
        m, n, at = self.time.size, self.start.shape[0], self.states["correlated"]
        rows = np.array([*range(NAV), at, at + 1, at + 2])
        out = np.empty((m, 6)), np.empty((m, 6)), np.empty((m, 6, n)), rows, np.empty((m, 12)), np.empty((m, 12, n))
        cost: float = linear.forward(system, measured, (np.zeros(n), start), jumps, out)
        spans = (range(step.begin, step.end if step.kind.fills else step.begin + 1) for step in steps)
        rows = np.array(sorted({0, *chain(*spans)}))
        alive = n if jumps[1][:, -FAULTS:].any() else n - FAULTS  # without faults of fixes, their states are zero
        variance, inner = measured[2], (system, measured, out)
        score, information, u, uu, told, driven = run_back(inner, rows, alive)
        white = np.where(variance > 0.0, variance * (uu - u**2), 0.0).reshape(m, 2, 3).sum(axis=2)
        slopes = np.column_stack([white, driven])  # derivatives of the cost by log variances of position, velocity, IMU
        counts = np.column_stack([(variance > 0.0).reshape(m, 2, 3).sum(axis=2), np.full(m, NAV)])
        first, kept = information[0] - np.outer(score[0], score[0]), (rows, score, information)
        slope = self._slope(noise, slopes.sum(axis=0), first, told[:, :, NAV:])
        return Pass(cost, (counts - slopes) / weights, told[:, 0, :NAV].copy(), slope, inner, kept)

    def _slope(self, noise: Noise, by_blocks: FloatArray, first: FloatArray, told: FloatArray) -> FloatArray:
        """Compute derivatives of the cost by the noise figures (5,), with their prior.

        `by_blocks` (3,): derivatives by the logarithms of the variances of positions, velocities and IMU. `first`:
        information minus squared score at the start. `told` (m, 4, 3): of the time-correlated errors, see
        `insnav.kernels.linear.backward`.
        Source: S. J. Koopman, N. Shephard, "Exact score for time series models in state space form", Biometrika 79
        (1992) 823-826.
        """
        share, rate, lasting = noise.share, self.system[0] / noise.time, noise.lasting(self.correlated_sd)
        late, r, both, free = np.swapaxes(told, 0, 1)
        both, free, by = both - r * late, free - r**2, self.lasting[:, : first.shape[0]]  # of noise and state, smoothed
        size = (-np.expm1(-2.0 * rate) @ free + np.einsum("in,nk,ik->i", by, first, by)) @ lasting
        time = 2.0 * rate @ (both - lasting * free).sum(axis=1)
        position, velocity, imu = 2.0 * by_blocks
        more = position + 2.0 * size, velocity, imu, (1.0 - share) * size - share * by_blocks[0], time
        return np.asarray(more + 2.0 * np.divide(noise.figures, noise.sd**2))

    def cross(self, of: Pass, columns: FloatArray, at: int, reach: int) -> FloatArray:
        """Compute the cross information of steps at one epoch and at each other epoch, (m, d, d).

        `reach`: number of later epochs, or of earlier epochs if negative. Other epochs are zero.
        """
        last = int(np.clip(at + reach, 0, self.time.size - 1))
        return np.asarray(linear.cross(*of.inner, of.scores[1], at, columns, last))

    def _with(
        self, steps: tuple[Step, ...], noise: Noise
    ) -> tuple[tuple[NDArray[Any], ...], tuple[NDArray[Any], ...], FloatArray]:
        """Apply noise and faults: system, epochs and sizes of covariance increases, and first covariance."""
        span, phi, fade, q, qd = self.system
        by, at, lasting = np.exp(2.0 * noise.figures[IMU]), self.states["correlated"], noise.lasting(self.correlated_sd)
        fade, qd, start = fade.copy(), qd.copy(), self.start + self.lasting.T * lasting @ self.lasting
        kept = np.exp(-span / noise.time)[:, None]
        fade[:, at : at + 3], qd[:, at : at + 3] = kept, (1.0 - kept**2) * lasting
        cleared: IntArray = np.zeros(span.size, dtype=np.int64)
        opened: list[tuple[int, FloatArray]] = []
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
                opened += [(k, g) for k in range(step.begin, step.end)]
            else:
                opened.append((step.begin, g))
            if step.end and step.kind.name in CLEARED:
                cleared[step.end] |= CLEARED[step.kind.name]
            elif step.end:
                opened.append((step.end, g))
        opened.sort(key=lambda each: each[0])
        rows = np.array([row for row, _ in opened], dtype=np.int64)
        jumps = rows, np.array([g for _, g in opened]).reshape(rows.size, self.start.shape[0], 3)
        return (span, phi, fade, by * q, qd, cleared), jumps, start
