"""A gyro that is off for a while, as after a shock or with a loose contact: which, when, and by how much.

The noise found in a drive with such a fault holds it, as in-run bias, so that no gate sees it. So the rate by which one
axis is off between any two times is estimated beside the filter, as misalignments are (`insnav.filter.sensor_axes`), of
z always, of all where the noise is implausible for the IMU or fixes were rejected. The likeliest span is taken: A. S.
Willsky, H. L. Jones, "A generalized likelihood ratio approach to the detection and estimation of jumps in linear
systems", IEEE Trans. Autom. Control 21 (1976) 108-112. What is found is taken off the samples, noise is found anew, and
the span is refined. Where nothing of this is as likely as fixes that are moved, or later from then on, these are left
to the searches for them: gyros do not stand for what they do not do. A run that is lost is looked at up to there, and
again without what began there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from insnav import strapdown
from insnav.alignment.static import stationary, summarize
from insnav.filter.changes import AT_END
from insnav.filter.gps_delay import shown_again
from insnav.filter.innovation_likelihood import LATER, MOVED, InnovationLikelihood
from insnav.filter.noise_identification import identify_noise, known_likelihood, with_noise
from insnav.filter.noise_search import DriveNoise, climbed, cost_at
from insnav.filter.prepare import Prepared
from insnav.filter.shocks import LATE_START, LEAST_LATE
from insnav.filter.whole_record import OPEN, UNUSED
from insnav.findings import Code, Finding
from insnav.imu.specification import ImuSpec
from insnav.kernels.dynamics import NAV
from insnav.types import FloatArray, ImuData, StateChange
from insnav.units import DEG

SUSPECT = 4.0  # times the in-run bias of the preset: recorded cars have up to 2.5
PARTS, SHORTEST = 50, 4.0  # of the record that spans are made of at first, and how long at least [s]
STEP = 1.0  # from one end of a span to the next, where it is refined: `AT_END` about each [s]
ROUNDS, SETTLED = 12, 0.03  # at most, and the part of a rate that ends them
LOST_BY = 2.0  # so soon after its end a run is lost by a fault that goes on [s]
# twice the gain of the log-likelihood from which a span is looked at, and is worth runs without it, with the noise
# beside it in what was seen, and from which it is a fault: recorded drives without one have up to 29 and 92, hours of
# simulated ones up to 12, 36 random faults in bends 27 and more, and 1610 and more [-]
WORTH, SURELY = 20.0, 120.0
SOME = 8.0  # that which a run that is lost, or the first without it, must leave [-]
# After so many runs one that may be a fault has this gain: all that were had 100 and more then, and none that had less
# than 30 became one [-]
SOON, PROMISING = 2, 45.0
GROWN = 1.5  # and is so long: that of a run that is lost at once begins with one sample and grows with each run [s]
LONGEST = 0.6  # part of the record; what is off for longer, but not to the end, is a bias, and the rest is off
STAYS = 2.0  # twice the gain of the log-likelihood by which its ends do not move: they went to and fro [-]
LINEAR_ROUNDS = 4  # without another run
LEAST = 0.3 * DEG  # rate; biases that warm up and what vibration adds on a recorded car, 0.23 deg/s, are none [rad/s]
LEFT = 0.5  # of its gain, that by what fixes may do besides where they did more before: without a fault they agree [-]
LARGEST = 500.0 * DEG  # more is that of a run that is lost, no gyro's: 7000 deg/s of one with false fixes [rad/s]
# So many times as fast as at any other time, and so much faster, no vehicle turns while a gyro is off: about a run that
# was lost between houses one of 150 deg/s was found [rad/s]
FASTER, TURNING = 1.5, 10.0 * DEG
AT_REST = 0.5  # least part of it that a rest within it must show
SLIGHT = 0.25  # part of that by which a gyro that is off may seem so about a run without it
ALIKE = 0.3  # part of the largest gain from which an axis is tried: the run with the fault is not linear in it
SHORTEST_FOUND = 3.0  # what is shorter is left at ends of another one, or what the model of a recorded car lacks [s]
OPENED = 1.0  # part of the rate by which the bias is opened where a span begins and ends, known to about a second
MOST = 3  # in one drive
HEADING = 2  # the axis that is looked at in every drive: weak fixes hardly show a heading, tilts they do


_Seen = tuple[InnovationLikelihood, FloatArray]  # innovations of a run, and the logarithms of figures of its noise


@dataclass(frozen=True, slots=True)
class Episode:
    """What is off for a while: a gyro, or the fixes."""

    cause: int  # axis of the gyro, or what fixes do, as of `InnovationLikelihood.by_spans`
    begin: float  # [s]
    end: float
    rate: float  # [rad/s], [s], [m]
    gain: float  # twice the gain of the log-likelihood by it [-]

    def near(self, other: Episode) -> bool:
        """Whether another one is the same, as far as the search for it goes."""
        ends = max(abs(self.begin - other.begin), abs(self.end - other.end))
        return ends <= STEP + 1e-6 and abs(self.angle - other.angle) < SETTLED * abs(self.angle)

    def beside(self, other: Episode) -> bool:
        """Whether another one of the same gyro is at the same time, or just before or after."""
        return self.cause == other.cause and max(self.begin - other.end, other.begin - self.end) < AT_END

    def part_of(self, other: Episode) -> bool:
        """Whether it is what another one, larger, has left about itself."""
        return self.beside(other) and abs(self.angle) < abs(other.angle)

    @property
    def angle(self) -> float:
        """In all, which a drive tells better than rate and ends alone [rad]."""
        return self.rate * (self.end - self.begin)

    def bearable(self, imu: ImuData) -> bool:
        """Whether the vehicle would not turn far faster without it than in as long times before and after."""
        span = strapdown.nominal_interval(imu.time) if imu.sampling == "increment" else 1.0
        first, last = np.searchsorted(imu.time, [self.begin, self.end], side="right")
        turned = np.concatenate([[0.0], np.cumsum(self.taken_off(imu).gyro[:, self.cause] / span)])
        length = int(last - first)
        if length == 0:
            return False
        means = np.abs(turned[length:] - turned[:-length]) / length
        elsewhere = np.concatenate([means[: max(first - length + 1, 0)], means[last:]])
        return bool(means[first] < FASTER * float(elsewhere.max(initial=0.0)) + TURNING)

    def seen_at_rest(self, ready: Prepared) -> bool:
        """Whether the longest rest within it, if there is one, has another rate than the longest before or after."""
        parts = strapdown.intervals(ready.imu, ready.nominal)
        rests = sorted(stationary(parts, shortest=SHORTEST), key=lambda each: each[0] - each[1])
        within = next((each for each in rests if self.begin < each[0] and each[1] < self.end), None)
        beside = next((each for each in rests if each[1] < self.begin or self.end < each[0]), None)
        if within is None or beside is None:
            return True
        rate, usual = (summarize(parts, *each).rate[self.cause] for each in (within, beside))
        return bool((rate - usual) / self.rate > AT_REST)

    def taken_off(self, imu: ImuData) -> ImuData:
        """Samples without it."""
        inside, gyro = (imu.time > self.begin) & (imu.time <= self.end), imu.gyro.copy()
        span = strapdown.nominal_interval(imu.time) if imu.sampling == "increment" else 1.0
        gyro[inside, self.cause] -= self.rate * span
        return replace(imu, gyro=gyro)


def without_gyro_faults(ready: Prepared, found: DriveNoise, spec: ImuSpec) -> tuple[Prepared, DriveNoise]:
    """Recording without gyros that are off for a while, as far as the drive shows them, and its noise.

    `found`: noise of the recording as it is; `spec`: that it was prepared with.
    """
    every = list[Episode]()
    while len(every) < MOST and found.seen is not None:
        suspect = found.far_off or found.seen[0].rejected() or _in_run_bias(found.spec) > SUSPECT * _in_run_bias(spec)
        seen = _opened(ready, found) if suspect else found.seen
        other = None if seen is None else _one(ready, spec, seen, found.seen, (0, 1, 2) if suspect else (HEADING,))
        if other is None:
            break
        fault, ready, found = other
        every.append(fault)
    changes, faults = list(ready.settings.changes), list(ready.faults)
    for fault in every:
        if not any(map(fault.part_of, every)):
            gyro, span = f"gyro {'xyz'[fault.cause]}", (fault.begin, fault.end)
            faults.append(Finding.of(Code.CHANGE_GYRO_FAULT, *span, subject=gyro, rate_rad_s=fault.rate))
        opened = OPENED * abs(fault.rate) * np.eye(3)[fault.cause]
        changes += [StateChange(at, NAV, opened, fault.gain, -np.inf) for at in (fault.begin, fault.end)]
    settings = ready.settings
    if every and settings.surest > 0.0:  # because of these parts of the drive disagreed
        settings = shown_again(ready)
    settings = replace(settings, changes=tuple(sorted(changes, key=lambda each: each.time)))
    return replace(ready, settings=settings, faults=tuple(faults)), replace(found, seen=None)


def _in_run_bias(spec: ImuSpec) -> float:
    return float(np.sqrt(np.mean(spec.gyro.bias_instability**2)))


def _one(
    ready: Prepared, spec: ImuSpec, seen: _Seen, gated: _Seen, axes: tuple[int, ...]
) -> tuple[Episode, Prepared, DriveNoise] | None:
    """The fault of one of the `axes` that stands out most in what was `seen`, the recording without it, its noise.

    `gated`: what was seen with what gates reject left out.
    """
    alike = set[int]()  # axes of which all runs were looked at as a whole already
    for cut in (True, False):  # what is seen after a run was lost misleads, but may be all that shows a fault
        look = _looked_at(seen, cut)
        plain = _plain(look)
        spans, rival = list[Episode](), 0.0
        if max(each.gain for each in _spans(look, axes)) >= WORTH:
            spans, rival = _spans(plain, axes), _rival(ready, look)
        least = max(WORTH, ALIKE * max((each.gain for each in spans), default=0.0), ALIKE * rival)
        spans.sort(key=lambda each: -each.gain)
        likely = [fault for fault in spans if fault.gain >= least and abs(fault.rate) >= SLIGHT * LEAST]
        likely = [fault for fault in likely if fault.cause not in alike]
        # noise found with a fault is a summit of its own
        tops = [climbed(*each) for each in ((look, plain) if (plain[1] < look[1]).any() else (look,)) if likely]
        tried = [_worth(look, fault, tops) for fault in likely]
        if look[0] is not seen[0]:  # what shows it may be cut off
            tried += [fault for fault, worth in zip(likely, tried, strict=True) if worth is None]
        elif not any(tried):  # the whole is what was looked at
            return None
        for fault in filter(None, tried):
            settled, lost = _settled(ready, spec, fault, cut)
            if settled is None:
                alike |= {fault.cause} if look[0] is seen[0] and not lost else set()
                continue
            left = _opened(*settled[1:])
            # what was lost already may be so far off that anything fits it; fixes that gates reject explain more then
            if left is not None and _dearer(left, gated):
                continue
            if rival <= fault.gain:
                return settled
            if left is not None and _rival(settled[1], _looked_at(left, cut)) < LEFT * settled[0].gain:
                return settled
    return None


def _worth(look: _Seen, fault: Episode, tops: list[tuple[FloatArray, float]]) -> Episode | None:
    """A fault without which the innovations at hand are likelier, each with its likeliest noise, near `tops` with it.

    A look without another run: noise found with a fault holds it, so that its own gain is small.
    """
    drive = look[0]
    edges, before = _edges(drive), min(cost for _, cost in tops)
    for _ in range(LINEAR_ROUNDS):
        without = drive.without(fault.begin, fault.end, fault.cause, fault.rate)
        there, cost = min((climbed(without, top) for top, _ in tops), key=itemgetter(1))
        if 2.0 * (before - cost) > WORTH:
            return fault
        last, fault = fault, _likeliest(*drive.by_spans(there, edges, fault.cause), edges, fault.cause)
        if fault.near(last):
            break
    return None


def _dearer(left: _Seen, gated: _Seen) -> bool:
    """Whether all innovations that are `left` cost more than those that gates pass, with as much for the others."""
    most, used = cost_at(*gated), gated[0].fixes
    most += max(gated[0].offered - used, 0) * (most / used + UNUSED) + SURELY
    return cost_at(*left) > most and climbed(*left)[1] > most


def _plain(look: _Seen) -> _Seen:
    """What was seen, with gyros that are no worse than those of the kind: noise found with a fault hides it."""
    most = [p.middle if p.key.startswith("gyro.") else np.inf for p in look[0].parameters]
    return look[0], np.minimum(look[1], most)


def _looked_at(seen: _Seen, cut: bool) -> _Seen:
    """What was seen, up to where a run is lost if it is `cut` there."""
    return (seen[0].linear(seen[1]), seen[1]) if cut else seen


def _spans(look: _Seen, causes: tuple[int, ...]) -> list[Episode]:
    """Where each of the causes is likeliest."""
    drive, at = look
    edges = _edges(drive)
    return [_likeliest(*drive.by_spans(at, edges, cause), edges, cause) for cause in causes]


def _rival(ready: Prepared, look: _Seen) -> float:
    """Gain by what else may look like a gyro: fixes that are later from then on, or off for a while."""
    small = ready.settings.gates.small_of(np.median(ready.gps.position_sd, axis=0))
    others = _spans(look, (LATER, MOVED, MOVED + 1, MOVED + 2))
    least = (LEAST_LATE, small, small, small)
    return max((o.gain for o, size in zip(others, least, strict=True) if abs(o.rate) > size), default=0.0)


def _opened(ready: Prepared, found: DriveNoise) -> _Seen | None:
    """The likelihood of all fixes, with the noise that was found: what was rejected tells most."""
    open_ = replace(ready, settings=replace(ready.settings, gates=OPEN))
    seen = None if found.seen is None else known_likelihood(with_noise(open_, found), found.seen[0].prior)
    if seen is None or found.seen is None:
        return None
    of_imu = sum(not p.key.startswith("gps.") for p in seen[0].parameters)
    return seen[0], np.concatenate([found.seen[1][:of_imu], seen[1][of_imu:]])


def _edges(drive: InnovationLikelihood) -> FloatArray:
    """Of the spans that are looked at, (k + 1,) [s]: where the attitude is known."""
    begin, end = drive.times[0] + LATE_START, drive.times[-1]
    return np.linspace(min(begin, end), end, int(np.clip((end - begin) / SHORTEST, 1, PARTS)) + 1)


def _settled(
    ready: Prepared, spec: ImuSpec, fault: Episode, cut: bool
) -> tuple[tuple[Episode, Prepared, DriveNoise] | None, bool]:
    """Refine a fault about runs without it, with the noise of these, as long as it changes; none if it does not last.

    `cut`: a run that is lost is looked at up to there. A fault that is there until then may be so to the end.
    Returns: the fault, the recording without it, its noise; and whether one of the runs was cut.
    """
    any_lost, last, again = False, fault, None
    for count in range(ROUNDS):
        some = replace(ready, imu=fault.taken_off(ready.imu))
        again = identify_noise(some, spec, again)
        seen = None if again is None else _opened(some, again)
        if again is None or seen is None:
            break
        drive, at = _looked_at(seen, cut)
        if drive.times[-1] < fault.begin:  # which shows nothing of it
            drive = seen[0]
        lost = drive is not seen[0]
        any_lost |= lost
        edges = _edges(drive)
        begin, end = edges[[0, -1]]
        reach = max(AT_END, edges[1] - edges[0])
        near = STEP * np.arange(-np.ceil(reach / STEP), np.ceil(reach / STEP) + 1.0)  # the ends themselves among them
        edges = np.unique(np.clip(np.concatenate([edges, fault.begin + near, min(fault.end, end) + near]), begin, end))
        spans = drive.by_spans(at, edges, fault.cause)
        before, fault = fault, _likeliest(*spans, edges, fault.cause, fault)
        least = SOME if lost or count == 0 else WORTH if count < SOON else PROMISING
        if fault.gain < least or not SLIGHT * LEAST <= abs(fault.rate) <= LARGEST:
            break
        if count >= SOON and fault.end - fault.begin < GROWN:
            break
        settled = fault.near(before)
        if settled:
            fault = _likeliest(*spans, edges, fault.cause, before, 0.0)
        if settled or count == ROUNDS - 1:  # what goes to and fro may be as sure
            if fault.gain <= SURELY or abs(fault.rate) <= LEAST or fault.end - fault.begin < SHORTEST_FOUND - 1e-6:
                break
            if not (fault.bearable(ready.imu) and fault.seen_at_rest(ready)):
                break
            some = replace(ready, imu=fault.taken_off(ready.imu))
            again = identify_noise(some, spec, again)
            return None if again is None else (fault, some, again), any_lost
        last, same = fault, fault.near(last)
        if lost and fault.end > end - LOST_BY and not same:
            fault = replace(fault, end=float(ready.imu.time[-1]))
    return None, any_lost


def _likeliest(
    e: FloatArray,
    weight: FloatArray,
    by: FloatArray,
    edges: FloatArray,
    cause: int,
    before: Episode | None = None,
    least: float = STAYS,
) -> Episode:
    """The span, of all between two of the `edges` (k + 1,), in which a cause is likeliest; a delay stays.

    `e`, `weight` (n,): innovations and inverse variances; `by` (k, n): innovations by a rate between edges; `before`:
    what is taken off already, whose ends move for a gain of `least` only.
    """
    if before is not None:
        e = e - before.rate * by[(edges[:-1] >= before.begin - 1e-6) & (edges[1:] <= before.end + 1e-6)].sum(axis=0)
    whole = np.vstack([np.zeros(e.size), np.cumsum(by, axis=0)])
    fisher, slope = (whole * weight) @ whole.T, -(whole * weight) @ e
    first, last = np.triu_indices(edges.size, 1)
    to_the_end, length = last == edges.size - 1, edges[last] - edges[first]
    passes = (length <= LONGEST * (edges[-1] - edges[0])) | to_the_end & (first > 0)
    chosen = to_the_end if cause == LATER else passes
    first, last = first[chosen], last[chosen]
    own = np.maximum(fisher[first, first] + fisher[last, last] - 2.0 * fisher[first, last], 1e-12)
    pull = slope[last] - slope[first]
    gain = pull**2 / own
    best = int(np.argmax(gain))
    if before is not None:
        moved = np.maximum(np.abs(edges[first] - before.begin), np.abs(edges[last] - before.end))
        stays = (moved < 1e-6) & (gain > gain[best] - least)
        best = int(np.argmax(stays)) if stays.any() else best
    span = edges[first[best]], edges[last[best]]
    return Episode(cause, float(span[0]), float(span[1]), float((pull / own)[best]), float(gain[best]))
