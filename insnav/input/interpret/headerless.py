"""Tables without a meaningful header: columns identified by their values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.exceptions import InputError
from insnav.input.formats.table import Table
from insnav.input.interpret.velocities import fit_velocities
from insnav.types import FloatArray
from insnav.units import DEG

_ROWS = 50_000  # rows examined
_GRAVITIES = (9.8, 1.0, 1000.0)  # in m/s^2, g and mg
_TOLERANCE = 0.05
_LAT, _LON, _HEIGHT, _SPAN = 90.0, 360.0, 1e5, 20.0


def is_headerless(headers: Sequence[str]) -> bool:
    """Return whether headers are column numbers, as in tables without a header."""
    return tuple(headers) == tuple(str(i + 1) for i in range(len(headers)))


def imu_columns(table: Table) -> dict[str, str]:
    """Identify the columns of time, gyros and accelerometers by their values.

    Time increases with every row. Three adjacent columns show gravity, three others are the gyros. Empty if ambiguous.
    """
    columns = _columns(table)
    times = [i for i, values in enumerate(columns) if _advances(values)]
    if len(times) != 1:
        return {}
    rest = [i for i in range(len(columns)) if i != times[0]]
    triads = [rest[k : k + 3] for k in range(len(rest) - 2) if rest[k + 2] - rest[k] == 2]
    heavy = [triad for triad in triads if _shows_gravity([columns[i] for i in triad])]
    if len(heavy) != 1:
        return {}
    others = [triad for triad in triads if not set(triad) & set(heavy[0])]
    if len(others) != 1:
        return {}
    found = {"time": times[0]}
    found |= {f"gyro_{axis}": i for axis, i in zip("xyz", others[0], strict=True)}
    found |= {f"accel_{axis}": i for axis, i in zip("xyz", heavy[0], strict=True)}
    return {key: table.headers[i] for key, i in found.items()}


def position_columns(table: Table) -> dict[str, str]:
    """Identify columns of time, and of latitude, longitude and height in this order.

    Also the first velocities North and East that agree with the position changes.
    """
    columns = _columns(table)
    times = [i for i, values in enumerate(columns) if _advances(values)]
    for at in range(times[0] + 1, len(columns) - 2) if times else ():
        lat, lon, height = columns[at : at + 3]
        limits = all(
            np.nanmax(np.abs(values), initial=0.0) <= limit
            for values, limit in ((lat, _LAT), (lon, _LON), (height, _HEIGHT))
        )
        if limits and max(np.ptp(lat), np.ptp(lon)) < _SPAN and not (lat == np.round(lat)).all():
            found = dict(zip(("time", "lat", "lon", "height"), (times[0], at, at + 1, at + 2), strict=True))
            lla = np.column_stack([lat * DEG, lon * DEG, height])
            for k in range(at + 3, len(columns) - 2):
                fit = fit_velocities(columns[times[0]], lla, np.column_stack(columns[k : k + 3]))
                if fit is not None and fit.as_named and not fit.misplaced:
                    found |= {"vn": k, "ve": k + 1}
                    break
            return {key: table.headers[i] for key, i in found.items()}
    return {}


def _columns(table: Table) -> list[FloatArray]:
    try:
        numbers = table.cells.read(range(len(table.headers)))
    except InputError:  # it contains text
        return []
    return [numbers.columns[i][:_ROWS] for i in range(len(table.headers))]


def _advances(values: FloatArray) -> bool:
    step = np.diff(values[np.isfinite(values)])
    return len(step) > 2 and bool(np.mean(step > 0.0) > 0.98) and bool(np.ptp(step) < 1e3 * abs(np.median(step)))


def _shows_gravity(triad: Sequence[FloatArray]) -> bool:
    norm = np.linalg.norm(np.column_stack(triad), axis=1)
    middle = float(np.nanmedian(norm))
    return any(abs(middle / gravity - 1.0) < _TOLERANCE for gravity in _GRAVITIES)
