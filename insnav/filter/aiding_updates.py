"""The filter's use of what helps it besides fixes: gated like fixes, counted, kept for the smoother."""

from __future__ import annotations

import numpy as np

from insnav.filter import gates as gate
from insnav.filter.aiding import INTERVAL, Aiding
from insnav.filter.estimate import Estimate
from insnav.filter.run_recorder import Record
from insnav.filter.settings import FilterSettings
from insnav.kernels.aiding_measurements import course, innovation, still
from insnav.kernels.aiding_measurements import wheels as kernel_wheels
from insnav.types import Event, EventKind, FloatArray, Increments


class Helper:
    """Height, rest, wheels and heading on their way into an estimate.

    Parameters
    ----------
    estimate : Estimate
        Corrected.
    settings : FilterSettings
        What helps, and the gates.
    record : Record
        Told of every measurement and rejection.
    start : float
        Time of the start [s].
    """

    def __init__(self, estimate: Estimate, settings: FilterSettings, record: Record, start: float) -> None:
        self._estimate, self._settings, self._record = estimate, settings, record
        self._turned, self._last = np.zeros(4), start
        self._z, self._h, self._r = np.zeros(6), np.zeros((6, estimate.at.states)), np.zeros((6, 6))

    def turned(self, inc: Increments, first: int, last: int) -> None:
        """Take note of how the body turned."""
        if self._settings.aiding is not None:
            self._turned[:3] += inc.dtheta[first:last].sum(axis=0)
            self._turned[3] += inc.dt[first:last].sum()

    def use(self, time: float) -> None:
        """Use what is known besides fixes, at most once in `INTERVAL`."""
        begin, span, aiding = self._last, self._turned[3], self._settings.aiding
        if aiding is None or time - begin < 0.9 * INTERVAL:
            return
        rate = self._turned[:3] / span
        self._turned[:] = 0.0
        self._last = time
        z, h, x = self._z, self._h, self._estimate.x
        if aiding.height is not None:
            h[0] = 0.0
            h[0, 2] = -1.0  # the error of position is down
            z[0] = x[2] - float(np.interp(time, aiding.height.time, aiding.height.height))
            self._offer(time, 0, 1, np.array([aiding.height.sd]), (EventKind.GATE_HEIGHT, "m"))
        if aiding.resting(begin, time):
            still(x, self._estimate.correction[:3], rate, z, h)
            sd = np.concatenate([np.full(3, aiding.rest_velocity_sd), aiding.rest_rate_sd])
            self._offer(time, 0, 6 if np.isfinite(sd).all() else 3, sd, (EventKind.GATE_REST, "m/s, rad/s"))
            return
        self._use_wheels(time, aiding)

    def _use_wheels(self, time: float, aiding: Aiding) -> None:
        wheels, odometer, estimate, z, h = aiding.wheels, aiding.odometer, self._estimate, self._z, self._h
        if wheels is None or float(np.hypot(estimate.x[3], estimate.x[4])) < wheels.slowest:
            return
        speed = np.nan if odometer is None else float(np.interp(time, odometer.time, odometer.speed))
        kernel_wheels(estimate.x, estimate.motion[:3], wheels.to_vehicle, wheels.lever_b, speed, z, h)
        sd = np.array([odometer.sd if odometer is not None else np.inf, *wheels.sd])
        if np.isfinite(speed):
            self._offer(time, 0, 1, sd, (EventKind.GATE_ODOMETER, "m/s"))
            kernel_wheels(estimate.x, estimate.motion[:3], wheels.to_vehicle, wheels.lever_b, speed, z, h)
        self._offer(time, 1, 3, sd, (EventKind.GATE_WHEELS, "m/s"))

    def steer(self, time: float, heading: float) -> None:
        """Use the heading of a fix [rad], if it has one and it is wanted."""
        sd = self._settings.heading_sd
        if sd > 0.0 and np.isfinite(heading):
            course(self._estimate.x, heading, self._z, self._h)
            self._offer(time, 0, 1, np.array([sd]), (EventKind.GATE_HEADING, "rad"))

    def _offer(self, time: float, first: int, last: int, sd: FloatArray, what: tuple[EventKind, str]) -> None:
        """Offer rows of the measurement to the estimate; the gate may keep it off."""
        z, h, r, estimate = self._z, self._h, self._r, self._estimate
        variance = np.zeros(6)
        variance[: sd.shape[0]] = sd**2
        m = last - first
        nis = innovation(estimate.covariance, z, h, variance, first, last, np.empty((m, m)))
        limit = self._settings.gates.limit(m)
        self._record.aid(what[0], z[first:last], nis, nis <= limit)
        if nis > limit:
            self._record.event(Event(time, what[0], nis, limit, f"NIS ({m} dof)", gate.REJECTED, "wheels or rest"))
            return
        r[:] = 0.0
        np.fill_diagonal(r, np.where(variance > 0.0, variance, 1.0))
        part = slice(first, last)
        estimate.epoch(time)
        if estimate.history is not None:
            estimate.history.aid(first, last, z, h, r)
        estimate.correct(time, z[part], h[part], r[part, part])
