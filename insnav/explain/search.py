"""Search of faults: score, test, accept and prune, within a budget of passes over the record.

The cost is -2 ln of the evidence: the likelihood of the fixes with Student's t errors, and the priors of weights,
faults and noise. A fixed point gives the size of a step (D. J. C. MacKay, "Bayesian interpolation", Neural Computation
4 (1992) 415-447, eq. 4.5 ff.). The weights of fixes are nearly equal in the first pass and become stricter from pass to
pass (H. Yang et al., "Graduated non-convexity for robust spatial perception", IEEE Robotics and Automation Letters 5
(2020) 1127-1134; Agamennoni et al., IEEE Transactions on Signal Processing 60 (2012) 5024-5037).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from insnav.explain.kinds import Kind, cost_of_end
from insnav.explain.proposals import TOPS, Proposal, misfit_of, propose
from insnav.explain.record import FAR, FIGURES, IMU, LARGEST_WEIGHT, TAILS, WEIGHTED, LinearRecord, Noise, Pass, Step
from insnav.tabular import runs_of
from insnav.types import BoolArray, FloatArray

ACCEPT = 6.0  # approximation error of -2 ln evidence: explanations that differ by less count as equal [-]
GRADUATED = (300.0, 100.0, 30.0, 10.0, 3.0, 1.0)  # divisors of the squared residuals, from first to last pass
AGAIN = (1.0,) * 4  # divisors to refit an explanation that changes little
CONVERGED = (1.0,) * 24  # divisors to fit until the cost no longer decreases
SLOW = ACCEPT / len(AGAIN)  # a fit ends after two passes that each decrease the cost by less [-]
# Limits of the noise figures for additional proposals: half the IMU noise, as larger noise may hide faults; 0: no limit
QUIET = np.array([0.0, 0.0, -0.7, 0.0, 0.0])
TRIED = 4  # largest number of proposals tested in a round
SOON = 60.0  # two steps within a minute may be begin and end of one fault, see `insnav.explain.kinds.ENDS` [s]
ALONE = 2  # largest number of successive false fixes that low weights explain without a fault
WEAK = 0.3  # weight below which a fix counts as false [-]
SIZE_RANGE = np.array([1e-6, 1e6])  # limits of a step's variance over the squared typical size; prior costs 33 there
FEWEST = 20  # least number of epochs with a fix for a search
BUDGET = 600  # largest number of passes over one part of a drive
SAME = 0.1  # sizes of faults are final if another filter run changes them by less than this share [-]


@dataclass(frozen=True, slots=True)
class Fit:
    """Explanation fitted to a record: faults, weights of fixes and IMU, and noise figures."""

    steps: tuple[Step, ...]
    weights: FloatArray  # (m, 3) of positions, velocities and the noise of the IMU; see `WEIGHTED`
    noise: Noise
    cost: float  # cost of the explanation: -2 ln of its evidence [-]
    seen: Pass  # the pass with these faults, weights and noise figures
    curve: FloatArray  # (5, 5) second derivatives of the cost by the noise figures, approximately [-]

    @property
    def is_lost(self) -> bool:
        """True if the IMU noise is at its limit: a missing fault makes errors too large for the linear model."""
        return self.noise.figures[IMU] > FAR * FIGURES[IMU][0] - 0.01


@dataclass(frozen=True, slots=True)
class Considered:
    """Tested addition of faults to a fit."""

    steps: tuple[Step, ...]  # steps that the previous fit did not have
    gain: float  # decrease of the cost by the new steps [-]
    accepted: bool


@dataclass(frozen=True, slots=True)
class Search:
    """Best explanation of a record, alternatives of similar cost, and all tested faults."""

    best: Fit
    others: tuple[Fit, ...]
    considered: tuple[Considered, ...]
    passes: int  # number of passes over the record
    gains: tuple[float, ...]  # cost increase of the best fit without each of its steps [-]
    complete: bool = True  # false: a new fault of the IMU needs another run of the filter before the search continues
    before: Search | None = None  # earlier search of fewer epochs, until a filter run confirms the new fault
    limit: int = 0  # number of first epochs known to be too large for a linear model; 0: unknown


class _Searcher:
    """Fits of explanations to one record, with a list of all fits and the number of passes."""

    def __init__(self, record: LinearRecord, kinds: Sequence[Kind], passes: int) -> None:
        self.record, self.kinds, self.passes = record, kinds, passes
        self.fits: dict[tuple[Step, ...], Fit] = {}

    def look(self, steps: tuple[Step, ...], weights: FloatArray, noise: Noise) -> Pass:
        self.passes += 2
        return self.record.run(steps, weights, noise)

    def cost(self, seen: Pass, steps: tuple[Step, ...], weights: FloatArray, noise: Noise) -> float:
        """Compute -2 ln of the evidence [-]."""
        of_tails = TAILS * (weights - 1.0 - np.log(weights))
        of_weights = float(of_tails[:, :2][self.record.known].sum() + of_tails[:, 2].sum())
        priors = of_weights + noise.cost + prior_of(steps, self.record.interval)
        return seen.cost + priors if seen.is_finite else np.inf

    def settle(self, start: Fit, steps: tuple[Step, ...], strictness: Sequence[float] = AGAIN) -> Fit:
        """Fit weights, sizes of faults and noise figures, starting from another fit, until the cost decreases slowly.

        `strictness`: divisors of the squared residuals, one per pass. A divisor above every mean squared residual would
        leave the weights nearly equal, and is skipped. The curvature by the noise figures follows from changes of the
        slope (BFGS: J. Nocedal, S. J. Wright, Numerical Optimization, 2nd ed., 2006, eq. 6.19).
        """
        seen = start.seen if steps == start.steps else self.look(steps, start.weights, start.noise)
        fit = replace(start, steps=steps, cost=self.cost(seen, steps, start.weights, start.noise), seen=seen)
        slow = False
        for divisor in strictness:
            if not np.isfinite(fit.cost):
                return fit
            if divisor > max(1.0, (fit.seen.squares / WEIGHTED).max()):
                continue
            weights = np.minimum((TAILS + WEIGHTED) / (TAILS + fit.seen.squares / divisor), LARGEST_WEIGHT)
            steps = tuple(sized(self.record, fit.seen, step) for step in fit.steps)
            noise = fit.noise.tuned(fit.seen.slope, fit.curve) if divisor == 1.0 else fit.noise
            if (steps, noise) == (fit.steps, fit.noise) and np.array_equal(weights, fit.weights):
                continue
            seen, curve = self.look(steps, weights, noise), fit.curve
            move, change = np.subtract(noise.figures, fit.noise.figures), seen.slope - fit.seen.slope
            if move @ change > 0.0:
                along = curve @ move
                curve = curve + np.outer(change, change) / (move @ change) - np.outer(along, along) / (move @ along)
            candidate = Fit(steps, weights, noise, self.cost(seen, steps, weights, noise), seen, curve)
            # if the cost increases, the step was too long: keep only its curvature
            gain = fit.cost - candidate.cost
            fit = candidate if divisor > 1.0 or gain > -ACCEPT else replace(fit, curve=curve)
            was_slow, slow = slow, divisor == 1.0 and 0.0 <= gain < SLOW
            if was_slow and slow:
                break
        steps, seen = fit.steps, fit.seen
        self.fits[steps] = replace(fit, seen=seen.bare())
        return fit

    def proposals(self, fit: Fit) -> list[tuple[Proposal, Fit]]:
        """Propose faults with the present weights, with weak weights set to one, and with low IMU noise."""
        quiet = fit.noise.moved(np.minimum(0.0, QUIET - fit.noise.figures) * (QUIET < 0.0))
        cases = [(fit.weights, fit.noise), (believed(fit.weights, self.record.known), fit.noise), (fit.weights, quiet)]
        rows = runs_of(np.asarray(false_for_long(fit.weights, self.record.known).any(axis=1)))
        longest = rows[np.argsort(rows[:, 0] - rows[:, 1], kind="stable")[:TOPS]]
        gathered = []
        for number, (weights, noise) in enumerate(cases):
            if number and np.allclose(weights, fit.weights, atol=0.75) and noise == fit.noise:
                continue
            seen = fit.seen if number == 0 else self.look(fit.steps, weights, noise)
            if not seen.is_finite:
                continue
            altered = replace(fit, weights=weights, cost=self.cost(seen, fit.steps, weights, noise), seen=seen)
            loss = altered.cost - fit.cost  # cost of the changed weights or noise
            gathered += [
                (each._replace(gain=each.gain - loss), altered)
                for each in propose(self.record, seen, self.kinds, fit.steps, false=longest, believed=number == 1)
            ]
        return sorted(gathered, key=lambda each: -each[0].gain)

    def improve(self, fit: Fit, considered: list[Considered]) -> Fit:
        """Fit the best proposal of each form, see `form_of`. Return the best fit, or the old faults fitted again."""
        trials: dict[int, Fit] = {}
        forms = set[tuple[str, bool]]()
        for proposal, start in self.proposals(fit):
            form = form_of(proposal, fit.steps)
            if form in forms or proposal.gain <= 0.0:
                continue
            forms.add(form)
            added = with_known(proposal, fit.steps)
            slow = any(step.kind.fills for step in added)  # intervals of noise need more passes
            trial = self.settle(start, added, CONVERGED if slow else AGAIN)
            trials[len(considered)] = trial
            new = tuple(step for step in added if step not in fit.steps)
            considered.append(Considered(new, fit.cost - trial.cost, accepted=False))
            if len(forms) == TRIED or self.passes > BUDGET:
                break
        for number, trial in sorted(trials.items(), key=lambda each: each[1].cost):
            if trial.cost > fit.cost - ACCEPT:
                break
            fit = min(fit, self.settle(trial, fit.steps), key=lambda each: each.cost)  # refit without its faults
            if self.is_real(fit, trial, considered[number].steps):
                considered[number] = replace(considered[number], accepted=True)
                return trial
        return fit

    def is_real(self, before: Fit, trial: Fit, new: Sequence[Step]) -> bool:
        """Test whether new faults gain more than model errors do by chance, and change the solution."""
        return trial.cost < before.cost - self.least(trial, new) and matters(before, trial, self.record.known)

    def least(self, trial: Fit, new: Sequence[Step]) -> float:
        """Compute the gain that new faults must exceed: the gain that model errors of this drive reach by chance."""
        kinds = {step.kind.name: step.kind for step in new if step.kind.steps and not step.kind.fills}
        prior = prior_of(new, self.record.interval)
        rows = [row for step in new for row in (step.begin, step.end) if row]
        return max([ACCEPT, *(misfit_of(self.record, trial.seen, kind, rows) - prior for kind in kinds.values())])

    def relocate(self, fit: Fit) -> Fit:
        """Move each step to its best epoch or kind, given the other steps. Remove steps of small gain."""
        for number in reversed(range(len(fit.steps))):
            if self.passes > BUDGET:
                break
            others = fit.steps[:number] + fit.steps[number + 1 :]
            bare = self.settle(fit, others, AGAIN[:2])
            step = fit.steps[number]
            if not self.is_real(bare, fit, (step,)):
                fit = bare
                continue
            tried = [each for each in self._elsewhere(bare, step) if replace(each[0], variance=step.variance) != step]
            trials = [self.settle(fit, (*others, *each), AGAIN[:2]) for each in tried]
            better = [(each.cost, i) for i, each in enumerate(trials) if each.cost < fit.cost]
            real = (trials[i] for _, i in sorted(better) if self.is_real(bare, trials[i], tried[i]))
            fit = next(real, fit)
        return self.join(fit)

    def join(self, fit: Fit) -> Fit:
        """Replace steps within `SOON` of each other by one fault, if its cost is lower."""
        time = self.record.time
        for first, last in clusters([(time[step.begin], time[step.end or step.begin]) for step in fit.steps]):
            members = fit.steps[first:last]
            others = fit.steps[:first] + fit.steps[last:]
            whole = members[0].moved(members[0].begin, max(step.end or step.begin for step in members))
            bare = self.settle(fit, others, AGAIN[:2])
            trials = [self.settle(fit, (*others, *each), AGAIN[:2]) for each in self._elsewhere(bare, whole, 2 * TRIED)]
            best = min(trials, key=lambda each: each.cost, default=fit)
            if best.cost < fit.cost:
                return best
        return fit

    def _elsewhere(self, bare: Fit, step: Step, count: int = TRIED) -> list[tuple[Step, ...]]:
        """Propose alternatives to a fault: its begin or its end alone, and the best of each form near its time."""
        margin = max(30.0, self.record.time[step.end or step.begin] - self.record.time[step.begin])
        first, last = self.record.time[step.begin] - margin, self.record.time[step.end or step.begin] + margin
        best: dict[tuple[str, bool], Proposal] = {}
        edges = [row for row in (step.begin, step.end) if row]
        for each in propose(self.record, bare.seen, self.kinds, (), edges):
            time = self.record.time[each.steps[0].begin]
            if first <= time <= last:
                best.setdefault((each.steps[0].kind.name, each.steps[0].end > 0), each)
        ends = [(step.moved(row, 0),) for row in (step.begin, step.end) if step.end and not step.kind.fills]
        return ends + [each.steps for each in sorted(best.values(), key=lambda each: -each.gain)[:count]]


def search(
    record: LinearRecord, kinds: Sequence[Kind], known: Search | None = None, like: Fit | None = None, *, end: str = ""
) -> Search:
    """Search the faults of a record.

    `known`: earlier search to continue, with fewer epochs or of another filter run. `like`: fit of another part of the
    drive, which has similar noise. `end`: "lost" stops if the fit is lost, "once" also after the first new fault.
    """
    searcher = _Searcher(record, kinds, known.passes if known else 0)
    weights, curve = np.ones((record.time.size, WEIGHTED.size)), 2.0 / np.min(FIGURES, axis=1) ** 2
    curve[:IMU] = 4.0 * 3.0 * record.time.size  # each of the three values of a fix contributes 4
    like, steps = known.best if known else like, known.best.steps if known else ()
    noise, curve = (like.noise, like.curve) if like else (Noise(), np.diag(curve))
    if known and end == "once" and forms_of(steps):  # keep the IMU noise: larger noise would hide faults
        curve = curve + np.diag(1e12 * (np.arange(len(curve)) == IMU))
    start = Fit(steps, weights, noise, np.inf, searcher.look(steps, weights, noise), curve)
    fit = searcher.settle(start, steps, GRADUATED + CONVERGED)
    plain_cost = fit.cost
    if known and not np.isfinite(fit.cost):
        return search(record, kinds)
    if not np.isfinite(fit.cost) or (not known and most_are_weak(record, fit.weights)):
        return Search(fit, (), (), searcher.passes, ())
    if end and fit.is_lost:
        return Search(fit, (), (), searcher.passes, (0.0,) * len(steps), complete=False)
    if known and end != "once":
        if known.complete and same(fit.steps, steps):
            return replace(known, best=fit, passes=searcher.passes)
        fit = searcher.relocate(fit)
    # add one significant fault at a time; a fault of the IMU needs another filter run first
    considered, complete = list[Considered](), True
    while complete and searcher.passes < BUDGET:
        before, fit = fit, searcher.improve(fit, considered)
        if end == "once" or fit.steps == before.steps:
            break
        complete = all(step.kind.of_fixes for step in fit.steps if step not in before.steps)
        fit = searcher.relocate(fit) if complete else fit
    similar = [each for each in searcher.fits.values() if each.steps != fit.steps and each.cost < fit.cost + ACCEPT]
    remaining = [fit.steps[:i] + fit.steps[i + 1 :] for i in range(len(fit.steps) * (complete and end != "once"))]
    without = (searcher.settle(fit, rest).cost if rest or known else plain_cost for rest in remaining)
    gains = tuple(cost - fit.cost for cost in without) or (0.0,) * len(fit.steps)
    return Search(fit, tuple(similar), tuple(considered), searcher.passes, gains, complete)


def search_part(
    record: LinearRecord, kinds: Sequence[Kind], known: Search | None, like: Fit | None
) -> tuple[LinearRecord, Search]:
    """Search a record. If an IMU fault makes it nonlinear, search the fewest first epochs that show the fault.

    Returns the searched epochs and their search. If the next filter run does not confirm the fault, the epochs were too
    many for a linear model. The next search then adds half as many.
    """
    count, lower = record.time.size, len(known.best.weights) if known else FEWEST
    if known is None or (known.best.steps and not known.limit):
        result = search(record, kinds, known, like, end="lost")
        if result.complete or not result.best.is_lost:
            return record, result
        known = known and replace(known, passes=result.passes)
    if known is None or lower == count:  # the known faults made the record nonlinear: start again
        lower, known = FEWEST, search(record.until(FEWEST), kinds, None, like, end="once")
        if forms_of(known.best.steps):
            return record.until(lower), replace(known, complete=False)
    elif not known.limit:
        repeated = search(record.until(lower), kinds, replace(known, complete=False))
        if known.before and not dict(forms_of(known.best.steps)).keys() <= dict(forms_of(repeated.best.steps)).keys():
            before = replace(known.before, limit=lower, passes=repeated.passes, complete=False)
            return record.until(len(before.best.weights)), before
        if not same(repeated.best.steps, known.best.steps):
            return record.until(lower), replace(repeated, complete=False, before=known.before)
        known = repeated
    # bisect for the smallest number of first epochs that shows another fault of the IMU
    upper, step_size, candidate = known.limit or count, 1, None
    while upper - lower > 1:
        epochs = min(lower + step_size, (lower + upper) // 2)
        part = search(record.until(epochs), kinds, known, like, end="once")
        known = replace(known, passes=part.passes)
        if part.best.is_lost:
            upper, candidate = epochs, None
        elif forms_of(part.best.steps) != forms_of(known.best.steps):
            upper, candidate = epochs, part  # a new fault: try fewer epochs, as they are nearer to linear
        elif candidate is not None:
            break
        else:
            lower, step_size = epochs, 2 * step_size
    if candidate is not None:
        return record.until(upper), replace(candidate, complete=False, before=known)
    return record.until(upper), replace(search(record.until(upper), kinds, known, like), complete=upper == count)


def forms_of(steps: Sequence[Step]) -> list[tuple[str, bool]]:
    """Return the kind of each fault of the IMU, and whether the fault ends, in sorted order."""
    return sorted((step.kind.name, step.end > 0) for step in steps if not step.kind.of_fixes)


def same(some: Sequence[Step], others: Sequence[Step]) -> bool:
    """Test whether the faults of two records have the same kinds (IMU) and nearly the same sizes."""
    same_forms = len(some) == len(others) and forms_of(some) == forms_of(others)
    return same_forms and all(
        abs(np.sqrt(one.variance / two.variance) - 1.0) <= SAME
        for one, two in zip(some, others, strict=True)
        if two.variance
    )


def clusters(spans: Sequence[tuple[float, float]]) -> list[tuple[int, int]]:
    """Find groups of faults less than `SOON` apart: index of the first and index after the last. `spans`: times [s]."""
    groups, first = [], 0
    for index in range(1, len(spans) + 1):
        if index == len(spans) or spans[index][0] - max(end for _, end in spans[first:index]) > SOON:
            groups += [(first, index)] * (index - first > 1)
            first = index
    return groups


def matters(before: Fit, after: Fit, known: BoolArray) -> bool:
    """Test whether a fault moves the solution by its sd, doubles its variance, or explains fixes of low weight."""
    moved = (after.seen.nav - before.seen.nav) ** 2 > before.seen.nav_variance
    doubled = after.seen.nav_variance > 2.0 * before.seen.nav_variance
    explained = false_for_long(before.weights, known) & (after.weights > WEAK)
    return bool(moved.any() or doubled.any() or explained.any())


def sized(record: LinearRecord, seen: Pass, step: Step) -> Step:
    """Update the variance of a step by its score and information: one iteration of MacKay's fixed point."""
    if not step.kind.steps:
        return step
    columns = record.columns(step.kind)
    score, information = seen.at(step.begin, step.end if step.kind.fills else step.begin + 1, columns)
    mean, known = step.variance * score, step.variance * np.einsum("kaa->", information)
    return replace(step, variance=float(np.clip((mean**2).sum() / max(known, 1e-6), *(SIZE_RANGE * step.kind.size**2))))


def prior_of(steps: Sequence[Step], interval: float) -> float:
    """Compute -2 ln of the prior of faults [-]. `interval`: time between epochs [s]."""
    ends = sum(step.end > 0 for step in steps)
    return sum(float(step.kind.cost(step.variance, interval)) for step in steps) + ends * cost_of_end(interval)


def believed(weights: FloatArray, known: BoolArray) -> FloatArray:
    """Set weak weights (m, 3) to one, except in series of up to `ALONE` false fixes. `known` (m, 2): measured."""
    changed = np.where(weights < WEAK, 1.0, weights)
    for column in range(2):
        rows = np.flatnonzero(known[:, column])
        for first, last in runs_of(weights[rows, column] < WEAK):
            if last - first <= ALONE:
                changed[rows[first:last], column] = weights[rows[first:last], column]
    return changed


def false_for_long(weights: FloatArray, known: BoolArray) -> BoolArray:
    """Find the weak weights (m, 3) in series of more than `ALONE` false fixes. `known` (m, 2): available fixes."""
    return np.asarray((weights < WEAK) & (believed(weights, known) > WEAK))


def most_are_weak(record: LinearRecord, weights: FloatArray) -> bool:
    """Test whether most positions, or velocities, have weak weights in every part of 20 epochs: noise, not a fault."""
    parts = np.array_split(np.arange(record.time.size), max(2, record.time.size // 20))
    weak, measured = (weights[:, :2] < WEAK) & record.known, record.known
    few = [2 * weak[rows].sum(axis=0) <= measured[rows].sum(axis=0) for rows in parts if measured[rows].any()]
    return not np.any(few, axis=0).all()


def form_of(proposal: Proposal, known: tuple[Step, ...]) -> tuple[str, bool]:
    """Return the form of a proposal: the kind of its new fault, and whether this fault ends."""
    step = next((each for each in proposal.steps if each not in known), proposal.steps[0])
    return step.kind.name, step.end > 0


def with_known(proposal: Proposal, known: tuple[Step, ...]) -> tuple[Step, ...]:
    """Combine the steps of a proposal with the known steps that it does not replace."""
    begins = {(each.kind.name, each.begin) for each in proposal.steps}
    kept = (each for each in known if (each.kind.name, each.begin) not in begins)
    return tuple(sorted((*kept, *proposal.steps), key=lambda each: each.begin))
