"""Check of velocity columns against the position changes: unit, order, signs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.earth import ned_offset
from insnav.input.interpret.schema import ALL_UNITS
from insnav.types import FloatArray, IntArray
from insnav.units import DEG

SPAN = 2.0  # interval of position changes [s]: long against position noise, short against turns
_FEWEST = 5  # least number of position changes for any conclusion
_FIRM = 3.0  # a change is significant beyond this multiple of the position scatter
_SLOWEST = 1.0  # lower speeds are not used [m/s]
# Median relative difference of velocities and position changes: below the second limit, the column names are accepted.
# Another interpretation needs less than the first limit, and less than the third times the difference by the names.
_FITS, _WRONG, _BETTER = 0.2, 0.35, 0.35
_UNITS = {unit: ALL_UNITS[unit][1] for unit in ("m/s", "km/h", "knot", "cm/s", "mm/s", "ft/s", "mph")}
_LEAST_CLIMB = 0.01  # least RMS of height changes that determine the sign [m]
_CLIMBS = (2.0, 8.0, 32.0)  # intervals of height changes [s]; noise hides changes in short intervals
_OUTSIDE = 5.0  # multiple of the median difference beyond which a velocity is false
_RISES = 5.0  # the slope of climb over vertical velocity must be below one by this many sd; correct drives: 2.7
_FALLS = 3.0  # a reversed slope is below zero by this many sd; heights that drift before a flight: 2.5
_UP, _FEET = -1.0, 1.0 / 0.3048  # slope for a velocity up, and for heights in feet
_NEAR, _CLEAR = 0.25, 4.0  # relative tolerance of the slope of feet; the slope must exceed one by this many sd
# scale errors: interval of position changes [s], least RMS of the changes [m], rounds of outlier removal
_MOVE, _LEAST_MOVE, _TRIMMED = 8.0, 1.0, 3
_LONG_ENOUGH = 60.0  # shortest record for scale errors [s]: lagging velocities miss motion at the start
# least reported scale error, its least size in sd, and variance factor for time-correlated errors
_SCALED, _SURE, _LASTING = 0.03, 6.0, 4.0
_SIDE = 0.1  # largest median of lateral over forward speed: wheeled vehicles slip less than 6 deg
_RADIANS = 180.0 / np.pi
_EARTH_RADIUS = 6.37e6  # approximate radius for position changes [m]


@dataclass(frozen=True, slots=True)
class Fit:
    """Interpretation of velocity columns that agrees with the positions."""

    order: tuple[int, int]  # indices of the columns north and east, among ``vn``, ``ve``
    signs: tuple[float, float]
    unit: str  # unit of the three velocity columns
    ratio: float  # position change over integrated velocity, read as m/s
    climb: float = 1.0  # measured climb over climb by the third column, read as m/s down: 1, `_UP`, `_FEET`
    radians: str = ""  # quantity in radians: "positions", "latitudes" or "longitudes"; empty without
    exchanged: bool = False  # latitudes and longitudes are exchanged
    in_vehicle: bool = False  # the velocities are in vehicle axes: only the speed fits

    @property
    def upward(self) -> bool:
        """True if the third column is a velocity up."""
        return self.climb == _UP

    @property
    def as_named(self) -> bool:
        """True if the columns are north and east in this order, with these signs."""
        return self.order == (0, 1) and self.signs == (1.0, 1.0) and not self.in_vehicle

    @property
    def confusion(self) -> str:
        """Name of the mistake in the labels of the columns; empty without a mistake."""
        if self.radians:
            return f"{self.radians}_radians"
        if self.exchanged:
            return "positions_exchanged"
        if self.in_vehicle:
            return "velocity_in_vehicle"
        if not self.as_named:
            return "velocity_names"
        if self.unit != "m/s":
            return "velocity_unit"
        return "heights_feet" if self.climb == _FEET else "velocity_up" if self.upward else ""

    @property
    def misplaced(self) -> bool:
        """True if the position columns are mislabelled, not the velocity columns."""
        return bool(self.radians) or self.exchanged or self.climb == _FEET

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns that contain the velocities north and east, with signs, such as ``vn``, ``-ve``."""
        signed = zip(self.order, self.signs, strict=True)
        return tuple("-" * (sign < 0.0) + ("vn", "ve")[column] for column, sign in signed)


def turns_in_radians(time: FloatArray, lla: FloatArray, v_n: FloatArray, angles: FloatArray) -> bool:
    """Return True if attitude angles without unit, read as degrees, are radians: the heading then fits the course.

    `angles` (n, k): heading last. `v_n` (n, 3): NaN if unknown; the course then comes from `lla` [rad], [rad], [m].
    """
    rows = np.flatnonzero(np.isfinite(angles).all(axis=1))
    if len(rows) < _FEWEST or np.abs(angles[rows]).max() / DEG > 2.0 * np.pi + 1e-3:
        return False
    v = v_n[rows, :2]
    if not np.isfinite(v).all():
        rows = rows[np.unique(np.searchsorted(time[rows], np.arange(time[rows[0]], time[rows[-1]], SPAN)))]
        v = np.gradient(ned_offset(lla[rows], lla[rows[0]]), time[rows], axis=0) if len(rows) > 1 else v[:1]
    fast = np.hypot(v[:, 0], v[:, 1]) > _SLOWEST
    course, heading_read = np.arctan2(v[fast, 1], v[fast, 0]), angles[rows[fast], -1]

    def scatter(heading: FloatArray) -> float:
        return 1.0 - max(float(np.abs(np.mean(np.exp(1j * (course - sign * heading))))) for sign in (1.0, -1.0))

    return bool(fast.sum() >= _FEWEST and scatter(heading_read / DEG) < _BETTER**2 * scatter(heading_read))


def fit_velocities(time: FloatArray, lla: FloatArray, v_n: FloatArray) -> Fit | None:
    """Interpret velocity columns ``(n, 3)`` by positions ``(n, 3)`` [rad], [rad], [m]; None if unclear.

    Each order, sign and unit of the horizontal columns is compared with the position changes. An interpretation against
    the column names is chosen only if it fits and the names do not.
    """
    known = np.flatnonzero(np.isfinite(v_n[:, :2]).all(axis=1))
    if known.size < 2 * _FEWEST:
        return None
    t, v = time[known], v_n[known]
    north = lla[known, 0] * _EARTH_RADIUS
    east = (np.unwrap(lla[known, 1])) * np.cos(lla[known[0], 0]) * _EARTH_RADIUS
    path = np.column_stack([north, east, -lla[known, 2]])
    integral, least_span = _gone(t, v), max(SPAN, 2.5 * float(np.median(np.diff(t))))
    start, stop = _moves(t, least_span - 1e-9, 3.0 * least_span)
    if start.size < _FEWEST:
        return None
    span = t[stop] - t[start]
    moved, sums = path[stop] - path[start], integral[stop] - integral[start]
    level = np.linalg.norm(sums[:, :2], axis=1)
    firm = np.linalg.norm(moved[:, :2], axis=1) > np.maximum(_SLOWEST * span, _FIRM * _scatter(path[:, :2]))
    sizes = (level, *np.abs(sums[:, :2].T)), (np.linalg.norm(moved[:, :2], axis=1), *np.abs(moved[:, :2].T))
    # angles in radians, read as degrees, move 57 times less than the velocities predict
    for name, expected, actual in zip(("positions", "latitudes", "longitudes"), *sizes, strict=True):
        fast = expected > _SLOWEST * span
        if fast.sum() >= _FEWEST:
            ratios = expected[fast] / np.maximum(actual[fast], 1e-9)
            if 0.7 < float(np.median(ratios)) / _RADIANS < 1.4:
                return Fit((0, 1), (1.0, 1.0), "m/s", 1.0, radians=name)
    if np.count_nonzero(firm) < _FEWEST:
        return None
    moved, sums = moved[firm], sums[firm]
    size = np.linalg.norm(moved[:, :2], axis=1)

    def difference(order: tuple[int, int], signs: tuple[float, float], factor: float) -> float:
        apart = moved[:, :2] - sums[:, order] * signs * factor
        return float(np.median(np.linalg.norm(apart, axis=1) / size))

    ratio = float(np.median(size / np.maximum(np.linalg.norm(sums[:, :2], axis=1), 1e-9)))
    named_error = difference((0, 1), (1.0, 1.0), 1.0)
    distance = _gone(t, np.linalg.norm(v[:, :2], axis=1, keepdims=True))[:, 0]
    speed_apart = float(np.median(np.abs((distance[stop] - distance[start])[firm] / size - 1.0)))
    sizes_sorted = np.sort(np.abs(v[start][firm, :2]), axis=1)
    forward = float(np.median(sizes_sorted[:, 0] / np.maximum(sizes_sorted[:, 1], 1e-9))) < _SIDE < named_error
    # One column stays small, although roads lead in any direction: the columns are forward and lateral velocity.
    if forward and speed_apart < _BETTER * named_error:
        return Fit((0, 1), (1.0, 1.0), "m/s", ratio, in_vehicle=True)
    if named_error < _WRONG:
        return Fit((0, 1), (1.0, 1.0), "m/s", ratio, _climb(t, lla[known, 2], integral[:, 2]))
    orders: tuple[tuple[int, int], ...] = ((0, 1), (1, 0))
    # position changes if latitudes and longitudes are exchanged
    across = np.column_stack([lla[known, 1], lla[known, 0] * np.cos(lla[known[0], 1])]) * _EARTH_RADIUS
    exchanged_moved = (across[stop] - across[start])[firm]
    best = min(
        (difference(order, signs, factor), order, signs, unit)
        for order in orders
        for signs in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))
        for unit, factor in _UNITS.items()
    )
    exchanged_size = np.maximum(np.linalg.norm(exchanged_moved, axis=1), 1e-9)
    exchanged = float(np.median(np.linalg.norm(exchanged_moved - sums[:, :2], axis=1) / exchanged_size))
    if exchanged < min(_FITS, best[0]):
        return Fit((0, 1), (1.0, 1.0), "m/s", ratio, exchanged=True)
    if best[0] > min(_FITS, _BETTER * named_error):
        return Fit((0, 1), (1.0, 1.0), "m/s", ratio, in_vehicle=True) if speed_apart < _FITS else None
    factor = _UNITS[best[3]]
    return Fit(best[1], (best[2][0], best[2][1]), best[3], ratio, _climb(t, lla[known, 2], integral[:, 2] * factor))


def scales(time: FloatArray, lla: FloatArray, v_n: FloatArray) -> list[tuple[str, float, float]]:
    """Find axes with a significant scale error between positions and velocities; return name, scale and its sd.

    Noise biases both regression slopes towards zero: of position changes on integrated velocities, and the reverse. The
    true scale is between the first and the inverse of the second (W. A. Fuller, "Measurement Error Models", Wiley 1987,
    section 1.1). Both limits must differ from one.
    """
    known = np.flatnonzero(np.isfinite(v_n).all(axis=1))
    if known.size < 2 * _FEWEST or np.ptp(time[known]) < _LONG_ENOUGH:
        return []
    integral, place = _gone(time[known], v_n[known]), lla[known]
    start, stop = _moves(time[known], _MOVE, 1.5 * _MOVE)
    by_velocity, by_position = integral[stop] - integral[start], ned_offset(place[stop], place[start])
    errors = []
    for name, sums, moved in zip(("north", "east", "up and down"), by_velocity.T, by_position.T, strict=True):
        if name == "up and down" and sums.size:  # a standing receiver may report a mean climb of centimetres per second
            sums, moved = sums - sums.mean(), moved - moved.mean()
        for _ in range(_TRIMMED):  # exclude outliers, such as false fixes
            product = float(sums @ moved)
            if sums.size < _FEWEST or product <= 0.0:
                break
            slope = float(np.sqrt((moved @ moved) / (sums @ sums)))
            apart = np.abs(moved - slope * sums)
            kept = apart <= _OUTSIDE * np.median(apart)
            sums, moved = sums[kept], moved[kept]
        if min(moved @ moved, sums @ sums) < sums.size * _LEAST_MOVE**2 or (product := float(sums @ moved)) <= 0.0:
            continue
        low, high = product / float(sums @ sums), float(moved @ moved) / product
        scale = low if low > 1.0 else min(high, 1.0)
        # overlap of the intervals and time-correlated fix errors increase the variance
        scatter = float(np.std(moved - scale * sums)) * np.sqrt(max(float(np.median(stop - start)), 1.0) * _LASTING)
        sd = scatter / float(np.linalg.norm(sums))
        if abs(scale - 1.0) > max(_SCALED, _SURE * sd):
            errors.append((name, scale, sd))
    return errors


def _gone(time: FloatArray, v_n: FloatArray) -> FloatArray:
    """Integrate velocities ``(n, k)`` [m/s] over time; the first row is zero [m]."""
    return np.vstack([np.zeros(v_n.shape[1]), np.cumsum(0.5 * (v_n[1:] + v_n[:-1]) * np.diff(time)[:, None], axis=0)])


def _moves(time: FloatArray, least: float, most: float) -> tuple[IntArray, IntArray]:
    """Return first and last row of each interval that takes from `least` to `most` [s]."""
    stop = np.searchsorted(time, time + least)
    start = np.flatnonzero(stop < len(time))
    stop = stop[start]
    near = time[stop] - time[start] < most
    return start[near], stop[near]


def _scatter(path: FloatArray) -> float:
    """Estimate the position noise of a smooth track [m]: its third differences have 20 times the variance."""
    if len(path) < 8:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(path, n=3, axis=0))) / np.sqrt(20.0))


def _climb(time: FloatArray, height: FloatArray, fallen: FloatArray) -> float:
    """Return `_UP` (-1) or `_FEET` (3.28) if descent over integrated velocity `fallen` [m] shows it; otherwise 1."""
    for span in _CLIMBS:
        start, stop = _moves(time, span, 2.0 * span)
        sums, moved = fallen[stop] - fallen[start], height[start] - height[stop]
        apart = np.min([np.abs(moved - by * sums) for by in (1.0, _UP, _FEET)], axis=0)  # residual of the nearest slope
        kept = apart <= _OUTSIDE * np.median(apart) if len(apart) else apart < 0.0
        sums, moved = sums[kept], moved[kept]
        power = float(np.sum(sums**2))
        if len(sums) < _FEWEST or not power > len(sums) * _LEAST_CLIMB**2:  # NaN also skips this span
            continue
        slope = float(np.sum(moved * sums)) / power
        scatter = float(np.std(moved - slope * sums)) * np.sqrt(float(np.median(stop - start)))  # intervals overlap
        sd = scatter / np.sqrt(power)
        if slope < -0.5 and slope < min(1.0 - _RISES * sd, -_FALLS * sd):
            return _UP
        if abs(slope / _FEET - 1.0) < _NEAR and slope > 1.0 + _CLEAR * sd:
            return _FEET
    return 1.0
