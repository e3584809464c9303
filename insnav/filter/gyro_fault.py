"""A gyro that is off for a while, as after a shock or with a loose contact: which, when, and by how much.

The noise found in a drive with such a fault holds it, as in-run bias, so that no gate sees it. So the rate by which one
axis is off between any two times is estimated beside the filter, as misalignments are (`insnav.filter.sensor_axes`), of
z always, of all where the noise is implausible for the IMU or fixes were rejected. The likeliest span is taken: A. S.
Willsky, H. L. Jones, "A generalized likelihood ratio approach to the detection and estimation of jumps in linear
systems", IEEE Trans. Autom. Control 21 (1976) 108-112. What is found is taken off the samples, noise is found anew, and
the span is refined.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insnav import strapdown
from insnav.filter.noise_identification import NoiseEstimate, identify_noise, known_likelihood, with_noise
from insnav.filter.prepare import Prepared
from insnav.filter.whole_record import OPEN
from insnav.imu.specification import ImuSpec
from insnav.kernels.dynamics import NAV
from insnav.plain_text import moment
from insnav.types import Event, EventKind, FloatArray, ImuData, StateChange
from insnav.units import DEG

SUSPECT = 4.0  # times the in-run bias of the preset: recorded cars have up to 2.5
PARTS, SHORTEST = 50, 4.0  # of the record that spans are made of at first, and how long at least [s]
REACH, STEP = 6.0, 1.0  # about the ends of a span and from one to the next, where it is refined [s]
ROUNDS, SETTLED = 12, 0.03  # at most, and the part of a rate that ends them
# twice the gain of the log-likelihood from which a span is looked at, and from which, with the noise beside it, it is a
# fault: recorded drives without one have up to 47 and 81 [-]
LOOKED_AT, SURELY = 15.0, 100.0
LEAST = 0.3 * DEG  # rate; biases that warm up and what vibration adds on a recorded car, 0.23 deg/s, are none [rad/s]
OPENED = 0.5  # part of the rate by which the bias is opened where a span begins and ends
MOST = 3  # in one drive
HEADING = 2  # the axis that is looked at in every drive: weak fixes hardly show a heading, tilts they do


@dataclass(frozen=True, slots=True)
class GyroFault:
    """An axis that is off for a while."""

    axis: int
    begin: float  # [s]
    end: float
    rate: float  # [rad/s]
    gain: float  # twice the gain of the log-likelihood by it [-]

    def taken_off(self, imu: ImuData) -> ImuData:
        """Samples without it."""
        inside, gyro = (imu.time > self.begin) & (imu.time <= self.end), imu.gyro.copy()
        span = strapdown.nominal_interval(imu.time) if imu.sampling == "increment" else 1.0
        gyro[inside, self.axis] -= self.rate * span
        return replace(imu, gyro=gyro)


def without_gyro_faults(ready: Prepared, found: NoiseEstimate, spec: ImuSpec) -> tuple[Prepared, NoiseEstimate]:
    """Recording without gyros that are off for a while, as far as the drive shows them, and its noise.

    `found`: noise of the recording as it is; `spec`: that it was prepared with.
    """
    said, ends = list[Event](), list[StateChange]()
    while len(said) < MOST:
        other = _one(ready, found, spec, (0, 1, 2) if _suspect(found, spec) else (HEADING,))
        if other is None:
            break
        fault, ready, found = other
        rate, when = fault.rate / DEG, moment(fault.begin, fault.end)
        text = (
            f"gyro {'xyz'[fault.axis]} is off by {rate:+.2g} deg/s from {when}: taken off, standard deviations opened"
        )
        said.append(Event(fault.begin, EventKind.CONTRADICTION, abs(rate), np.nan, "deg/s", text))
        opened = OPENED * abs(fault.rate) * np.eye(3)[fault.axis]
        ends += [StateChange(at, NAV, opened, fault.gain, -np.inf) for at in (fault.begin, fault.end)]
    changes = sorted((*ready.settings.changes, *ends), key=lambda each: each.time)
    settings = replace(ready.settings, changes=tuple(changes))
    return replace(ready, settings=settings, faults=(*ready.faults, *said)), replace(found, seen=None)


def _suspect(found: NoiseEstimate, spec: ImuSpec) -> bool:
    """Whether noise holds what no gyro of the kind has, or innovations lack what was rejected."""
    size, usual = (float(np.mean(each.gyro.bias_instability**2)) ** 0.5 for each in (found.spec, spec))
    return found.far_off or found.seen is None or found.seen[0].rejected() or size > SUSPECT * usual


def _one(
    ready: Prepared, found: NoiseEstimate, spec: ImuSpec, axes: tuple[int, ...]
) -> tuple[GyroFault, Prepared, NoiseEstimate] | None:
    """The fault of one of the `axes` that stands out most, the recording without it, and its noise."""
    fault, some = None, ready
    for _ in range(ROUNDS):
        likelihood = found.seen
        if fault is not None or len(axes) > 1:
            open_ = replace(some, settings=replace(some.settings, gates=OPEN))  # what was rejected tells most
            likelihood = known_likelihood(with_noise(open_, found), found.filter_spec)
        if likelihood is None:
            return None
        drive, at = likelihood
        begin, end = float(drive.times[0]), float(drive.times[-1])
        edges = np.linspace(begin, end, int(np.clip((end - begin) / SHORTEST, 1, PARTS)) + 1)
        if fault is not None:
            axes = (fault.axis,)
            reach = max(REACH, edges[1] - edges[0])
            near = np.arange(-reach, reach + STEP, STEP)
            edges = np.unique(np.clip(np.concatenate([edges, fault.begin + near, fault.end + near]), begin, end))
        spans = [_likeliest(*drive.by_rates(at, edges, axis), edges, axis, fault) for axis in axes]
        before, fault = fault, max(spans, key=lambda each: each.gain)
        if fault.gain < (LOOKED_AT if before is None else SURELY):
            return None
        some = replace(ready, imu=fault.taken_off(ready.imu))
        again = identify_noise(some, spec)
        if again is None:
            return None
        found = again
        if before is not None and abs(fault.rate - before.rate) < SETTLED * abs(fault.rate):
            break
    return None if fault is None or abs(fault.rate) < LEAST else (fault, some, found)


def _likeliest(
    e: FloatArray, weight: FloatArray, by: FloatArray, edges: FloatArray, axis: int, before: GyroFault | None
) -> GyroFault:
    """The span, of all between two of the `edges` (k + 1,), in which an axis is likeliest off.

    `e`, `weight` (n,): innovations and inverse variances; `by` (k, n): innovations by a rate between edges; `before`:
    what is taken off already.
    """
    if before is not None:
        e = e - before.rate * by[(edges[:-1] >= before.begin - 1e-6) & (edges[1:] <= before.end + 1e-6)].sum(axis=0)
    whole = np.vstack([np.zeros(e.size), np.cumsum(by, axis=0)])
    fisher, slope = (whole * weight) @ whole.T, -(whole * weight) @ e
    first, last = np.triu_indices(edges.size, 1)
    own = np.maximum(fisher[first, first] + fisher[last, last] - 2.0 * fisher[first, last], 1e-12)
    pull = slope[last] - slope[first]
    best = int(np.argmax(pull**2 / own))
    span = edges[first[best]], edges[last[best]]
    return GyroFault(axis, float(span[0]), float(span[1]), float((pull / own)[best]), float((pull**2 / own)[best]))
