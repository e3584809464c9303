"""Outputs, innovations and events of a run, collected on the way and put into shape at its end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from insnav import spill
from insnav.exceptions import InputError
from insnav.filter.changes import largest_change
from insnav.filter.measurements.measurement import Measurement
from insnav.filter.settings import FilterSettings
from insnav.filter.shocks import shock
from insnav.filter.smoother import SmoothedErrors
from insnav.filter.state_layout import layout
from insnav.kernels.dynamics import NAV
from insnav.kernels.errorstate import SENSOR, STATES, at_fix_time, feed_back, move_along
from insnav.kernels.output import moved, solution
from insnav.kernels.smoother import apply
from insnav.types import (
    AidingUse,
    Alignment,
    Epochs,
    Event,
    EventKind,
    FloatArray,
    Innovations,
    IntArray,
    Run,
    SensorErrors,
    Smoothed,
    Trajectory,
)

if TYPE_CHECKING:
    from insnav.filter.estimate import Estimate

CONSISTENCY_WINDOW = 60.0  # NIS is averaged over this long: time-correlated errors of fixes average out [s]
# Mean NIS, by its expectation, beyond which the filter has diverged. A mean far below one is no divergence: stationary,
# and with the cautious standard deviations of many receivers, it is the rule (30 minutes of a good recorded drive).
TOO_LARGE = 5.0
FALSE_FROM = 30.0  # a larger NIS of a position says no more, chi-square with three degrees of freedom [-]
ROOM = 1 << 16  # outputs, first: these stay in memory


class Record:
    """Growing record of outputs, fixes and events."""

    @dataclass(slots=True)
    class Rows:
        """Room for outputs; the first `used` rows are filled."""

        time: FloatArray
        state: FloatArray
        variance: FloatArray
        delay: FloatArray
        used: int = 0

    def __init__(self, fixes: int) -> None:
        self._rooms: list[Record.Rows] = []
        self._events: list[Event] = []
        self._aiding: dict[tuple[str, str], list[tuple[float, float, float]]] = {}
        self._count = 0
        self._time, self._innovation, self._sd = np.empty(fixes), np.empty((fixes, 6)), np.empty((fixes, 6))
        self._nis, self._use = np.empty((fixes, 2)), np.zeros((fixes, 2), dtype=bool)
        self._state, self._covariance = np.empty((fixes, 16)), spill.empty((fixes, NAV, NAV))
        self._delays = np.empty(fixes)
        self._sensor, self._sensor_sd = np.empty((fixes, 12)), np.empty((fixes, 12))

    def reserve(self, rows: int) -> Rows:
        """Room for at most `rows` more outputs."""
        before = sum(room.used for room in self._rooms)
        if not self._rooms or self._rooms[-1].time.shape[0] < self._rooms[-1].used + rows:
            size = max(ROOM, rows, before)  # few rooms however long the drive is
            room = spill.empty((30 * size,), large=bool(self._rooms))
            time, delay, state, variance = np.split(room, [size, 2 * size, 18 * size])
            self._rooms.append(Record.Rows(time, state.reshape(size, 16), variance.reshape(size, 12), delay))
        return self._rooms[-1]

    def event(self, event: Event) -> None:
        """Note an event."""
        self._events.append(event)

    def aiding(self, measurement: Measurement, innovation: FloatArray, nis: float, used: bool) -> None:
        """Note the innovation of an aiding measurement; at most its first three numbers are of one unit."""
        rows = self._aiding.setdefault((measurement.name, measurement.unit.split(",")[0]), [])
        rows.append((nis / innovation.shape[0], float(np.mean(innovation[:3] ** 2)), float(used)))

    def fix(
        self,
        time: float,
        predicted: FloatArray,
        sd: FloatArray,
        nis: tuple[float, float],
        use: list[bool],
        estimate: Estimate,
    ) -> None:
        """Note the innovation of a fix, as predicted minus measured, and the state after it."""
        i = self._count
        self._time[i] = time
        self._innovation[i], self._sd[i], self._nis[i], self._use[i] = predicted, sd, nis, use
        self._state[i, :10], self._state[i, 10:], self._delays[i] = estimate.x, estimate.motion, estimate.delay
        at_fix_time(estimate.covariance, estimate.x, self._covariance[i])
        self._sensor[i], self._sensor_sd[i] = estimate.correction, estimate.covariance.diagonal()[NAV:STATES]
        self._count += 1

    def misfit(self) -> float:
        """Twice the negative log-likelihood of a position's innovation, on average; false ones limited."""
        nis, sd = self._nis[: self._count, 0], self._sd[: self._count, :3]
        return float(np.mean(np.minimum(nis, FALSE_FROM) + 2.0 * np.log(sd).sum(axis=1)))

    def finish(
        self,
        alignment: Alignment,
        settings: FilterSettings,
        lever_b: FloatArray,
        axes_sd: FloatArray,
        delay: float,
        covariance: FloatArray,
        found: SmoothedErrors | None,
    ) -> Run:
        """Put everything into shape."""
        n, at = self._count, layout(settings)
        if not any(room.used for room in self._rooms):
            raise InputError(
                "no sample lies after the start of navigation",
                why="the IMU record ends where the first usable fix, or the initial state, is",
                fix="give a longer record, or check the time bases of both files",
            )
        time, delays, state, variance = (
            spill.joined([getattr(room, name)[: room.used] for room in self._rooms])
            for name in ("time", "delay", "state", "variance")
        )
        self._rooms.clear()
        known = np.flatnonzero(variance[:, 0] >= 0.0)
        variance = variance if known.size == time.size else spill.chosen(variance, known)
        innovations = Innovations(
            self._time[:n],
            -self._innovation[:n],
            self._sd[:n],
            *self._nis[:n].T,
            *self._use[:n].T,
        )
        self._events += _divergence(innovations)
        # an offset that was estimated, not given, is attributed to the IMU clock: GPS time is the better one
        clock = delay if settings.delay_sd > 0 else 0.0
        delay_sd = float(np.sqrt(covariance[STATES, STATES])) if at.delay >= 0 else 0.0
        unmoved = spill.by_blocks(np.copy, state) if found is not None else None
        if clock != 0.0:  # the offset as estimated at the time has put the state elsewhere along its velocity
            for block in spill.blocks(time.size):
                move_along(state[block], clock - delays[block])
            move_along(self._state[:n], clock - self._delays[:n])
        filtered = _trajectory(time + clock, state, known, variance, axes_sd, delay_sd)
        for block in spill.blocks(n):
            self._covariance[block] += _squared(_moved(self._state[block], delay_sd))
        smoothed = None
        if found is not None and unmoved is not None:
            rows = np.searchsorted(self._time[:n], found.time[found.used] - 1e-6)
            moved = _moved(self._state[rows], delay_sd)
            velocities = bool(np.isfinite(innovations.nis_velocity).any())
            changes, smallest = shock(found, velocities=velocities)
            self._events += changes
            smoothed = _smoothed(time, unmoved, filtered, found, axes_sd, delay_sd, clock, moved)
            smoothed = replace(smoothed, smallest_seen=smallest, changed=largest_change(found, velocities=velocities))
        spill.release()
        return Run(
            solution=filtered,
            innovations=innovations,
            sensor_errors=SensorErrors(self._time[:n] + clock, self._sensor[:n], np.sqrt(self._sensor_sd[:n])),
            events=tuple(sorted(self._events, key=lambda event: event.time)),
            alignment=alignment,
            epochs=Epochs(
                self._time[:n] + clock,
                self._state[:n, :3],
                self._state[:n, 3:6],
                self._state[:n, 6:10],
                self._covariance[:n],
            ),
            gps_delay=settings.delay + delay,
            gps_delay_sd=float(np.sqrt(covariance[STATES, STATES])) if covariance.shape[0] > STATES else 0.0,
            smoothed=smoothed,
            lever_b=lever_b.copy(),
            lever_sd=np.sqrt(covariance.diagonal()[at.lever : at.lever + 3]) if at.lever >= 0 else np.zeros(3),
            aiding=tuple(_aiding_use(*what, np.array(rows)) for what, rows in sorted(self._aiding.items())),
        )


def _aiding_use(name: str, unit: str, rows: FloatArray) -> AidingUse:
    used = rows[:, 2] > 0.0
    nis, square = (float(np.mean(rows[used, i])) if used.any() else 0.0 for i in (0, 1))
    return AidingUse(name, rows.shape[0], int((~used).sum()), float(np.sqrt(square)), nis, unit)


def _moved(state: FloatArray, delay_sd: float) -> FloatArray:
    """`moved` of states (n, 16), (n, 9)."""
    out = np.empty((state.shape[0], NAV))
    for row, by in zip(state, out, strict=True):
        moved(row, delay_sd, by)
    return out


def _squared(error: FloatArray) -> FloatArray:
    return error[:, :, None] * error[:, None]


def _trajectory(
    time: FloatArray,
    state: FloatArray,
    known: IntArray,
    variance: FloatArray,
    axes_sd: FloatArray,
    delay_sd: float,
) -> Trajectory:
    """States, and variances of the `known` ones, to a trajectory with roll, pitch, heading and standard deviations.

    Misalignment is no state of the filter but noise, which averages out as the misalignment does not: the attitude is
    that of the IMU, in which the axes of the sensors are turned by `axes_sd`.
    """
    rph, sd = spill.empty((time.shape[0], 3)), spill.empty((time.shape[0], NAV))
    for block in spill.blocks(known.shape[0]):
        # what lies between two known rows needs both
        before = slice(max(block.start - 1, 0), block.stop)
        first = known[before.start] if before.start else 0
        rows = slice(first, known[block.stop - 1] + 1 if block.stop < known.shape[0] else None)
        between = known[before] - first
        solution(time[rows], state[rows], between, variance[before], delay_sd, axes_sd, rph[rows], sd[rows])
    return Trajectory(time, state[:, :3], state[:, 3:6], rph, sd)


def _smoothed(
    time: FloatArray,
    state: FloatArray,
    filtered: Trajectory,
    found: SmoothedErrors,
    axes_sd: FloatArray,
    delay_sd: float,
    clock: float,
    moved: FloatArray,
) -> Smoothed:
    """Correct the filter's states by the smoothed errors; before the first and after the last epoch they stay.

    `moved` (m, 9): see `_moved`, at the epochs with a fix that was used.
    """
    variance = spill.empty((time.shape[0], NAV + 3))
    first = last = 0
    for block in spill.blocks(time.shape[0]):
        before, inside = apply(
            time[block], state[block], variance[block], found.time, found.after, found.before, found.covariance
        )
        first, last = first + before, last + inside
    whole = _trajectory(time + clock, state, np.arange(first, last), variance[first:last], axes_sd, delay_sd)
    assert whole.sd is not None
    assert filtered.sd is not None
    for part in (slice(0, first), slice(last, None)):
        state[part, :6] = np.hstack([filtered.lla[part], filtered.v_n[part]])
        whole.rph[part], whole.sd[part] = filtered.rph[part], filtered.sd[part]
    at, error = found.state[found.used].copy(), found.after[found.used]
    for row, wrong in zip(at, error, strict=True):
        feed_back(row, np.zeros(SENSOR), wrong)
    return Smoothed(
        whole,
        Epochs(
            found.time[found.used] + clock,
            at[:, :3],
            at[:, 3:6],
            at[:, 6:],
            spill.by_blocks(
                lambda row, some: found.covariance[row] + _squared(some), np.flatnonzero(found.used), moved
            ),
        ),
        SensorErrors(
            found.time[found.used] + clock,
            found.correction[found.used] - error[:, NAV:],
            np.sqrt(np.maximum(found.variance[found.used], 0.0)),
        ),
    )


def _divergence(innovations: Innovations) -> list[Event]:
    """Minutes in which accepted measurements are, on average, farther from their predictions than expected."""
    found: list[Event] = []
    if innovations.time.size == 0:
        return found
    window = np.floor((innovations.time - innovations.time[0]) / CONSISTENCY_WINDOW).astype(int)
    for name, nis, used in (
        ("position", innovations.nis_position, innovations.used_position),
        ("velocity", innovations.nis_velocity, innovations.used_velocity),
    ):
        count = np.bincount(window, weights=used)
        mean = np.bincount(window, weights=np.where(used, nis, 0.0)) / np.maximum(count, 1)
        for w in np.flatnonzero((count >= 20) & (mean / 3.0 > TOO_LARGE)):
            found.append(
                Event(
                    float(innovations.time[0] + w * CONSISTENCY_WINDOW),
                    EventKind.DIVERGED,
                    float(mean[w] / 3.0),
                    TOO_LARGE,
                    f"mean NIS of {name} / 3",
                    "flagged",
                    "optimistic sigmas of GPS or IMU file",
                )
            )
    return found
