"""Updates by aiding measurements: gated like fixes, counted, stored for the smoother."""

from __future__ import annotations

import numpy as np

from insnav.filter.estimate import Estimate
from insnav.filter.measurements.measurement import INTERVAL, FilterView, Measurement
from insnav.filter.measurements.sensors import Heading
from insnav.filter.run_recorder import Record
from insnav.filter.settings import FilterSettings
from insnav.findings import Code, Finding
from insnav.kernels.errorstate import Samples
from insnav.kernels.measurements import innovation
from insnav.types import FloatArray, GpsData


class AidingUpdates:
    """Aiding updates of one estimate, from the time `start` [s] on; fixes may come with a heading."""

    def __init__(
        self, estimate: Estimate, settings: FilterSettings, record: Record, gps: GpsData, start: float
    ) -> None:
        self._estimate, self._gates, self._record = estimate, settings.gates, record
        self._every, self._interval = settings.aiding, settings.aided_every
        self._with_fixes: list[Measurement] = []
        if settings.heading_sd > 0.0 and gps.heading is not None:
            sd = np.array([settings.heading_sd])
            self._with_fixes.append(Heading(gps.time - settings.delay, gps.heading, sd))
        self._turned, self._last = np.zeros(4), start
        self._z, self._h, self._r = np.zeros(6), np.zeros((6, estimate.at.states)), np.zeros((6, 6))

    def restart(self, time: float) -> None:
        """Reset the sums of the body rate."""
        self._turned[:] = 0.0
        self._last = time

    def turned(self, samples: Samples, first: int, last: int) -> None:
        """Sum the body rate over samples."""
        if self._every is not None:
            self._turned[:3] += samples.dtheta[first:last].sum(axis=0)
            self._turned[3] += samples.dt[first:last].sum()

    def at_fix(self, time: float) -> None:
        """Use the measurements that come with the fixes."""
        for each in self._with_fixes:
            self._use(each, self._view(time, time, np.zeros(3)))

    def at_epoch(self, time: float) -> None:
        """Use all other measurements, at most once per interval; the noise is scaled for those left out."""
        if self._every is None or time - self._last < 0.9 * self._interval:
            return
        view = self._view(self._last, time, self._turned[:3] / self._turned[3])
        self._turned[:] = 0.0
        self._last = time
        seen: set[str] = set()
        for each in self._every:
            if not each.excluded_by & seen and self._use(each, view, INTERVAL / self._interval):
                seen.add(each.name)

    def _view(self, begin: float, time: float, mean_gyro: FloatArray) -> FilterView:
        at = self._estimate
        return FilterView(begin, time, at.x, at.correction, at.motion[:3], mean_gyro, float(np.hypot(at.x[3], at.x[4])))

    def _use(self, measurement: Measurement, at: FilterView, noise: float = 1.0) -> bool:
        """Apply a measurement with its noise times `noise`, unless gated; return whether there was a measurement."""
        z, h, r, estimate = self._z, self._h, self._r, self._estimate
        part = measurement.observe(at, z, h)
        m = part.stop - part.start
        if m == 0:
            return False
        variance = np.ones(6)
        variance[part] = noise * measurement.sd[:m] ** 2
        nis = innovation(estimate.covariance, z, h, variance, part.start, part.stop, np.empty((m, m)))
        limit = self._gates.limit(m)
        self._record.aiding(measurement, z[part], nis, nis <= limit)
        if nis > limit:
            code, name = Code.GATE_AIDING, measurement.name
            self._record.event(Finding.of(code, at.time, subject=name, nis=nis, limit_nis=limit, dof=m))
            return True
        np.fill_diagonal(r, variance)
        estimate.epoch(at.time)
        if estimate.history is not None:
            estimate.history.aiding(part, z, h, r)
        estimate.correct(at.time, z[part], h[part], r[part, part])
        return True
