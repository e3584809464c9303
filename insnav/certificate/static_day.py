"""A day at rest with sensors that err: what comes of it against the closed form, amplitudes and periods."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.certificate.check import Check
from insnav.certificate.integrators import Integrator
from insnav.certificate.motions import even
from insnav.earth import earth_rate_n, gravity_n, ned_offset
from insnav.errors.schuler import measured_periods, periods, static_errors
from insnav.gimbal import PlatformErrors
from insnav.types import FloatArray, ImuData
from insnav.units import DEG, DEG_PER_H, UG

DAY = 86400.0  # [s]
PLACE = np.array([45.0 * DEG, 0.2, 0.0])
# small, as the closed form is linear, and so that each of them shows
ERRORS = PlatformErrors(
    tilt=np.array([0.0, 0.0, 20.0 / 3600.0]) * DEG,
    drift=np.array([1e-3, 1e-3, 1e-3]) * DEG_PER_H,
    bias=np.array([30.0, 30.0, 0.0]) * UG,
)
_AMPLITUDE, _PERIOD = 0.002, 0.001  # limits, as parts of what theory says
Record = tuple[str, FloatArray, FloatArray]  # integrator, time since the start [s], position error North, East [m]


def day(integrators: Sequence[Integrator]) -> list[Check]:
    """Strapdown navigators that are level and head north, height held."""
    time = even(DAY + 1.0, 1.0)
    dt = np.diff(time)[:, None]
    # a gyro that shows too much turns the computed axes the other way than a platform that drifts
    gyro, accel = earth_rate_n(PLACE[0]) - ERRORS.drift, ERRORS.bias - gravity_n(PLACE[0], PLACE[2])
    imu = ImuData(time[1:], dt * gyro, dt * accel, "increment")
    held = np.zeros(imu.time.size - 1)
    records = []
    for integrator in integrators:
        found = integrator.navigate(imu, (PLACE, np.zeros(3), -ERRORS.tilt), held, held, 60)
        records.append((integrator.name, found.time - imu.time[0], ned_offset(found.lla, PLACE)[:, :2]))
    return compared("a day at rest with errors", records)


def compared(topic: str, records: Sequence[Record], where: str = "") -> list[Check]:
    """Compare records of the position error with the closed form of `ERRORS`; `where` begins the cases."""
    theory = periods(float(PLACE[0]), float(PLACE[2]))
    found = [(name, _parts(time, position)) for name, time, position in records]
    cases = (
        ("error, in parts of its largest", _AMPLITUDE),
        (f"Schuler period, {theory.schuler / 60.0:.2f} min", _PERIOD),
        (f"Foucault period, {theory.foucault / 3600.0:.2f} h", _PERIOD),
        (f"Earth's period, {(theory.earth or 0.0) / 3600.0:.2f} h", _PERIOD),
    )
    return [
        Check(topic, where + case, "1", limit, tuple((name, parts[k]) for name, parts in found))
        for k, (case, limit) in enumerate(cases)
    ]


def _parts(time: FloatArray, position: FloatArray) -> tuple[float, ...]:
    """Largest error, Schuler, Foucault and Earth's period: how far off, in parts of what theory says."""
    if not np.isfinite(position).all():
        return (np.inf,) * 4
    lat, height = float(PLACE[0]), float(PLACE[2])
    theory = static_errors(time, lat, height, ERRORS).position
    off = float(np.abs(position - theory).max() / np.abs(theory).max())
    seen, true = measured_periods(time, position, lat, height), periods(lat, height)
    pairs = ((seen.schuler, true.schuler), (seen.foucault, true.foucault), (seen.earth, true.earth))
    return off, *(abs(a / b - 1.0) if a is not None and b is not None else np.inf for a, b in pairs)
