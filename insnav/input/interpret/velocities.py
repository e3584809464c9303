"""Whether velocities fit the positions beside them: unit, order and signs, by what the positions move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.earth import ned_offset
from insnav.input.interpret.schema import ALL_UNITS
from insnav.types import FloatArray, IntArray

SPAN = 2.0  # moves are taken over so long: the noise of positions counts less, turns little [s]
_FEWEST = 5  # moves that can tell
_FIRM = 3.0  # a move is firm if it is so many times the scatter of the positions
_SLOWEST = 1.0  # slower ones tell nothing [m/s]
# relative difference of move and velocity, median, that fits and that does not; another reading leaves far less of it
_FITS, _WRONG, _BETTER = 0.2, 0.35, 0.35
_UNITS = {unit: ALL_UNITS[unit][1] for unit in ("m/s", "km/h", "knot", "cm/s", "mm/s", "ft/s", "mph")}
_LEAST_CLIMB = 0.01  # moves in height that tell which way is up [m]
_CLIMBS = (2.0, 8.0, 32.0)  # lengths of moves in height: noise of heights hides short ones [s]
_OUTSIDE = 5.0  # times the median difference from any of these, beyond which a move is that of a false velocity
_RISES = 5.0  # standard deviations by which the slope of climb by vertical velocity is not one; good drives: 2.7
_FALLS = 3.0  # and by which it is negative: heights wander, and a flight before its start had -2.5
_UP, _FEET = -1.0, 1.0 / 0.3048  # that slope for a velocity up, and for heights in feet
_NEAR, _CLEAR = 0.25, 4.0  # part of the latter that it may differ by, and standard deviations from one of good drives
# moves whose scale is compared [s], how large they are [m], and how often without those of false fixes
_MOVE, _LEAST_MOVE, _TRIMMED = 8.0, 1.0, 3
_LONG_ENOUGH = 60.0  # velocities that lag move less far in a start alone [s]
# least scale error that is said, the same in standard deviations, and times its variance by errors that last
_SCALED, _SURE, _LASTING = 0.03, 6.0, 4.0
_SIDE = 0.1  # sideways by forward speed, median: a vehicle on wheels slips by less than 6 deg
_RADIANS = 180.0 / np.pi
_EARTH_RADIUS = 6.37e6  # a rough one will do [m]


@dataclass(frozen=True, slots=True)
class Fit:
    """How velocity columns are to be read so that they fit the positions."""

    order: tuple[int, int]  # column that is north, and that which is east
    signs: tuple[float, float]
    unit: str  # unit of all three
    ratio: float  # how many times as far as in m/s the positions move
    climb: float = 1.0  # how many times as far as it falls by the third column, read as m/s down, in what is read as m
    radians: str = ""  # what is in radians, not degrees: "positions", "latitudes" or "longitudes"; empty if nothing is
    exchanged: bool = False  # latitudes are longitudes
    in_vehicle: bool = False  # the velocities are forward and sideways, in the axes of the vehicle

    @property
    def upward(self) -> bool:
        """Whether the third column is a velocity up, not down."""
        return self.climb == _UP

    @property
    def as_named(self) -> bool:
        """Whether the columns are north and east in this order, with these signs."""
        return self.order == (0, 1) and self.signs == (1.0, 1.0) and not self.in_vehicle

    @property
    def confusion(self) -> str:
        """Name of what is confused in data taken as they are named; empty if nothing is."""
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
        """Whether it is the positions that are confused."""
        return bool(self.radians) or self.exchanged or self.climb == _FEET

    @property
    def columns(self) -> tuple[str, ...]:
        """What is north and what is east by the names of the columns: ``vn``, ``-ve``."""
        signed = zip(self.order, self.signs, strict=True)
        return tuple("-" * (sign < 0.0) + ("vn", "ve")[column] for column, sign in signed)


def fit_velocities(time: FloatArray, lla: FloatArray, v_n: FloatArray) -> Fit | None:
    """Compare positions ``(n, 3)`` [rad], [rad], [m] with velocity columns ``(n, 3)`` as in the file; None: no telling.

    Each order, sign and unit of the horizontal columns is compared with the moves; another than that of the names is
    taken only where it fits and the names do not.
    """
    known = np.flatnonzero(np.isfinite(v_n[:, :2]).all(axis=1))
    if known.size < 2 * _FEWEST:
        return None
    t, v = time[known], v_n[known]
    north = lla[known, 0] * _EARTH_RADIUS
    east = (np.unwrap(lla[known, 1])) * np.cos(lla[known[0], 0]) * _EARTH_RADIUS
    path = np.column_stack([north, east, -lla[known, 2]])
    gone, length = _gone(t, v), max(SPAN, 2.5 * float(np.median(np.diff(t))))
    start, stop = _moves(t, length - 1e-9, 3.0 * length)
    if start.size < _FEWEST:
        return None
    span = t[stop] - t[start]
    moved, said = path[stop] - path[start], gone[stop] - gone[start]
    level = np.linalg.norm(said[:, :2], axis=1)
    firm = np.linalg.norm(moved[:, :2], axis=1) > np.maximum(_SLOWEST * span, _FIRM * _scatter(path[:, :2]))
    sizes = (level, *np.abs(said[:, :2].T)), (np.linalg.norm(moved[:, :2], axis=1), *np.abs(moved[:, :2].T))
    for name, should, does in zip(("positions", "latitudes", "longitudes"), *sizes, strict=True):
        fast = should > _SLOWEST * span
        if fast.sum() >= _FEWEST:
            times = should[fast] / np.maximum(does[fast], 1e-9)
            if 0.7 < float(np.median(times)) / _RADIANS < 1.4:
                return Fit((0, 1), (1.0, 1.0), "m/s", 1.0, radians=name)
    if np.count_nonzero(firm) < _FEWEST:
        return None
    moved, said = moved[firm], said[firm]
    size = np.linalg.norm(moved[:, :2], axis=1)

    def difference(order: tuple[int, int], signs: tuple[float, float], factor: float) -> float:
        apart = moved[:, :2] - said[:, order] * signs * factor
        return float(np.median(np.linalg.norm(apart, axis=1) / size))

    ratio = float(np.median(size / np.maximum(np.linalg.norm(said[:, :2], axis=1), 1e-9)))
    given = difference((0, 1), (1.0, 1.0), 1.0)
    if given < _WRONG:
        return Fit((0, 1), (1.0, 1.0), "m/s", ratio, _climb(t, lla[known, 2], gone[:, 2]))
    orders: tuple[tuple[int, int], ...] = ((0, 1), (1, 0))
    across = np.column_stack([lla[known, 1], lla[known, 0] * np.cos(lla[known[0], 1])]) * _EARTH_RADIUS
    other = (across[stop] - across[start])[firm]
    best = min(
        (difference(order, signs, factor), order, signs, unit)
        for order in orders
        for signs in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))
        for unit, factor in _UNITS.items()
    )
    size_other = np.maximum(np.linalg.norm(other, axis=1), 1e-9)
    exchanged = float(np.median(np.linalg.norm(other - said[:, :2], axis=1) / size_other))
    if exchanged < min(_FITS, best[0]):
        return Fit((0, 1), (1.0, 1.0), "m/s", ratio, exchanged=True)
    if best[0] > min(_FITS, _BETTER * given):
        way = _gone(t, np.linalg.norm(v[:, :2], axis=1, keepdims=True))[:, 0]
        apart = np.abs((way[stop] - way[start])[firm] / size - 1.0)
        aside = np.sort(np.abs(v[start][firm, :2]), axis=1)
        alone = float(np.median(apart)) < _FITS and float(np.median(aside[:, 0] / aside[:, 1])) < _SIDE
        return Fit((0, 1), (1.0, 1.0), "m/s", ratio, in_vehicle=True) if alone else None
    factor = _UNITS[best[3]]
    return Fit(best[1], (best[2][0], best[2][1]), best[3], ratio, _climb(t, lla[known, 2], gone[:, 2] * factor))


def scales(time: FloatArray, lla: FloatArray, v_n: FloatArray) -> list[tuple[str, float, float]]:
    """Axes along which positions surely move otherwise than velocities say: name, how many times as far, and its sd.

    Both have noise, which makes the slope of moves by velocities too small, and that of velocities by moves: the true
    one lies between the first and the inverse of the second (W. A. Fuller, "Measurement Error Models", Wiley 1987,
    section 1.1), and both must tell another scale than one.
    """
    known = np.flatnonzero(np.isfinite(v_n).all(axis=1))
    if known.size < 2 * _FEWEST or np.ptp(time[known]) < _LONG_ENOUGH:
        return []
    gone, at = _gone(time[known], v_n[known]), lla[known]
    start, stop = _moves(time[known], _MOVE, 1.5 * _MOVE)
    by_velocity, by_position = gone[stop] - gone[start], ned_offset(at[stop], at[start])
    found = []
    for name, said, moved in zip(("north", "east", "up and down"), by_velocity.T, by_position.T, strict=True):
        if name == "up and down" and said.size:  # receivers climb by centimetres a second at rest
            said, moved = said - said.mean(), moved - moved.mean()
        for _ in range(_TRIMMED):  # false fixes do not count
            both = float(said @ moved)
            if said.size < _FEWEST or both <= 0.0:
                break
            slope = float(np.sqrt((moved @ moved) / (said @ said)))
            apart = np.abs(moved - slope * said)
            kept = apart <= _OUTSIDE * np.median(apart)
            said, moved = said[kept], moved[kept]
        if min(moved @ moved, said @ said) < said.size * _LEAST_MOVE**2 or (both := float(said @ moved)) <= 0.0:
            continue
        low, high = both / float(said @ said), float(moved @ moved) / both
        size = low if low > 1.0 else min(high, 1.0)
        # moves overlap, and errors of fixes last
        scatter = float(np.std(moved - size * said)) * np.sqrt(max(float(np.median(stop - start)), 1.0) * _LASTING)
        sd = scatter / float(np.linalg.norm(said))
        if abs(size - 1.0) > max(_SCALED, _SURE * sd):
            found.append((name, size, sd))
    return found


def _gone(time: FloatArray, v_n: FloatArray) -> FloatArray:
    """Velocities (n, k), integrated from the first on [m]."""
    return np.vstack([np.zeros(v_n.shape[1]), np.cumsum(0.5 * (v_n[1:] + v_n[:-1]) * np.diff(time)[:, None], axis=0)])


def _moves(time: FloatArray, least: float, most: float) -> tuple[IntArray, IntArray]:
    """First and last row of each move that lasts so long [s]."""
    stop = np.searchsorted(time, time + least)
    start = np.flatnonzero(stop < len(time))
    stop = stop[start]
    near = time[stop] - time[start] < most
    return start[near], stop[near]


def _scatter(path: FloatArray) -> float:
    """Noise of a smooth track, by third differences (variance 20 times that of the noise) [m]."""
    if len(path) < 8:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(path, n=3, axis=0))) / np.sqrt(20.0))


def _climb(time: FloatArray, height: FloatArray, fallen: FloatArray) -> float:
    """How far heights fall by the third velocity, over moves of some length, if not as far. `fallen`: its integral."""
    for span in _CLIMBS:
        start, stop = _moves(time, span, 2.0 * span)
        said, moved = fallen[stop] - fallen[start], height[start] - height[stop]
        apart = np.min([np.abs(moved - by * said) for by in (1.0, _UP, _FEET)], axis=0)  # false velocities are none
        kept = apart <= _OUTSIDE * np.median(apart) if len(apart) else apart < 0.0
        said, moved = said[kept], moved[kept]
        power = float(np.sum(said**2))
        if len(said) < _FEWEST or not power > len(said) * _LEAST_CLIMB**2:  # nor where one is not known
            continue
        slope = float(np.sum(moved * said)) / power
        scatter = float(np.std(moved - slope * said)) * np.sqrt(float(np.median(stop - start)))  # they overlap
        sd = scatter / np.sqrt(power)
        if slope < -0.5 and slope < min(1.0 - _RISES * sd, -_FALLS * sd):
            return _UP
        if abs(slope / _FEET - 1.0) < _NEAR and slope > 1.0 + _CLEAR * sd:
            return _FEET
    return 1.0
