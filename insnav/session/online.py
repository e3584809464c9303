"""Filter that is fed as data arrive, with the kernels and measurements of `insnav.filter.navigator`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from insnav import strapdown
from insnav.alignment.in_motion import sure_motion
from insnav.attitude import rph_from_quat
from insnav.exceptions import AlignmentError, InputError, InsnavError
from insnav.filter.error_model import Part
from insnav.filter.gps_noise import with_sd
from insnav.filter.navigator import Navigator
from insnav.filter.prepare import AFTER, DELAY_SD, LONGEST_GAP, SHORTEST, Start, prepare, spans
from insnav.filter.run_recorder import Record
from insnav.filter.settings import FilterSettings
from insnav.findings import Code, Finding
from insnav.imu.specification import ImuSpec
from insnav.kernels.errorstate import STATES, Outputs, variances
from insnav.kernels.output import deviations
from insnav.steps.given import LEVER_SD, checked, given_imu, vector
from insnav.steps.inputs import Inputs
from insnav.types import FloatArray, GpsData, ImuData, Sampling, Stamp

WINDOW = 2.0  # fixes older than this, relative to the newest sample, are refused [s]
APART = 0.25  # time between states to go back to [s]
RETRY = 1.0  # time between attempts of an alignment [s]
NO_ROWS = 1e9  # interval of a solution that is never written [s]
MOST = 1000  # newest findings that are kept


@dataclass(frozen=True, slots=True)
class OnlineState:
    """State of an online filter; ``NaN`` until it is aligned.

    Attributes
    ----------
    aligned : bool
        False until the data determine an attitude, and again after a gap of more than 3 s in the samples.
    time : float
        Time of the state [s]. It lags behind the newest sample by 0.1 s and 11 samples.
    lla : (3,) array
        Latitude, longitude [rad], ellipsoidal height [m], at the IMU.
    v_n : (3,) array
        Velocity North, East, Down [m/s].
    rph : (3,) array
        Roll, pitch, heading [rad].
    gyro_bias, accel_bias : (3,) array
        Estimated biases [rad/s], [m/s^2].
    covariance : (21, 21) array
        Of the errors, estimate minus truth: position N, E, D [m], velocity N, E, D [m/s], attitude ``phi`` [rad], gyro
        bias [rad/s], accelerometer bias [m/s^2], gyro and accelerometer scale factor [-].
    sd : (9,) array
        Standard deviation of position N, E, D [m], velocity N, E, D [m/s], roll, pitch, heading [rad].
    lever_arm : (3,) array
        Antenna seen from the IMU, body axes, specified or estimated [m].
    gps_delay : float
        Age of the fixes relative to their timestamps, specified or estimated [s].
    findings : tuple of Finding
        The newest thousand findings, in the order of their detection.
    """

    aligned: bool = False
    time: float = np.nan
    lla: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    v_n: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    rph: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    gyro_bias: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    accel_bias: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    covariance: FloatArray = field(default_factory=lambda: np.full((STATES, STATES), np.nan))
    sd: FloatArray = field(default_factory=lambda: np.full(9, np.nan))
    lever_arm: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    gps_delay: float = np.nan
    findings: tuple[Finding, ...] = ()


class _Findings(Record):
    """Record of a run that has no end: it keeps the findings alone."""

    def __init__(self) -> None:
        super().__init__(0)
        self.found: list[Finding] = []
        self._row: Outputs | None = None

    def event(self, event: Finding) -> None:
        self.found = [*self.found[1 - MOST :], event]

    def reserve(self, rows: int, grid: FloatArray) -> Outputs:
        self._row = self._row or super().reserve(rows, grid)
        self._row.used[:] = 0
        return self._row

    def epoch(self, *_: Any) -> None:
        pass

    fix = aiding = epoch


class OnlineFilter:
    """Loosely coupled INS/GPS filter that is fed as data arrive.

    It collects data until they determine an attitude: until the end of `static`, or 50 s after the first motion. It
    then navigates what it has collected, and each further block at once. Without motion it needs `static` and a
    heading, or gyros that measure the Earth's rotation. Fixes may arrive in any order within 2 s: the filter goes back
    and repeats the samples since.

    Parameters
    ----------
    imu : str, path or ImuSpec
        IMU error specification: a grade, a part, a file.
    lever_arm : (3,) array_like, optional
        Antenna seen from the IMU, forward, right, down [m]; estimated if absent.
    lever_arm_sd : float, optional
        Standard deviation of each component, which is estimated if above 0 [m]. By default 0, or 1 without `lever_arm`.
    gps_delay : float, optional
        Age of the fixes at their timestamps [s]; estimated if absent, up to a tenth of a second.
    heading : float, optional
        Heading at the start [rad].
    static : (float, float), optional
        Stationary interval for the alignment, in the time of the data [s].
    initial : str, path or Start, optional
        Initial state instead of an alignment; its file is as for ``insnav run --initial``.
    sampling, stamp : str
        Meaning of the samples and of their times, as in `insnav.ImuData`.
    rate : float, optional
        Samples per second [Hz]; by default their mean rate until the alignment.
    states : {21, 15}
        With or without scale factor errors.

    Raises
    ------
    ConfigError, InputError
        An input is invalid.

    Examples
    --------
    >>> nav = insnav.OnlineFilter(imu="stim300", lever_arm=(0.8, -0.3, -1.2))  # doctest: +SKIP
    >>> nav.gps(time, (lat, lon, height), v_n, sd=(1.5, 1.5, 3.0))  # doctest: +SKIP
    >>> nav.imu(times, gyro, accel)  # doctest: +SKIP
    >>> nav.state.lla, nav.state.sd  # doctest: +SKIP
    """

    def __init__(
        self,
        imu: str | Path | ImuSpec,
        lever_arm: Sequence[float] | FloatArray | None = None,
        *,
        lever_arm_sd: float | None = None,
        gps_delay: float | None = None,
        heading: float | None = None,
        static: tuple[float, float] | None = None,
        initial: str | Path | Start | None = None,
        sampling: Sampling = "mean",
        stamp: Stamp = "end",
        rate: float | None = None,
        states: int = 21,
    ) -> None:
        inputs: Inputs = {"imu_model": imu, "lever_arm": lever_arm, "lever_arm_sd": lever_arm_sd, "rate": rate}
        inputs |= {"gps_delay": gps_delay, "heading": heading, "static": static, "initial": initial}
        inputs |= {"sampling": sampling, "stamp": stamp}
        inputs = checked(inputs)
        given, arm = given_imu(imu), vector(inputs, "lever_arm")
        assert given is not None
        start = inputs.get("initial")
        self._spec, self._start, self._heading, self._static = given[0], start, heading, static
        self._settings = FilterSettings(
            lever_b=np.zeros(3) if arm is None else arm,
            lever_sd=(LEVER_SD if arm is None else 0.0) if lever_arm_sd is None else lever_arm_sd,
            delay=gps_delay or 0.0,
            delay_sd=DELAY_SD if gps_delay is None else 0.0,
            smooth=False,
            output_interval=NO_ROWS,
        )
        self._how, self._states, self._nominal = (sampling, stamp), states, None if rate is None else 1.0 / rate
        self._record = _Findings()
        self._record.event(given[1])
        self._nav: Navigator | None = None
        self._last, self._ended, self._retry = -np.inf, -np.inf, -np.inf  # newest sample, the one before a gap [s]
        self._aligning, self._held = True, list[ImuData]()  # samples for the next alignment
        self._fixes: list[tuple[float, GpsData]] = []  # by time in the clock of the samples [s]
        self._recent: list[ImuData] = []  # samples after the oldest state to go back to
        self._saved: list[tuple[float, float, tuple[Any, ...]]] = []  # time, newest sample, the state
        self._axes_sd, self._cause = np.zeros(3), None

    def imu(self, time: ArrayLike, gyro: ArrayLike, accel: ArrayLike) -> None:
        """Take the next samples.

        Parameters
        ----------
        time : float or (n,) array_like
            Time of each sample [s], after those before.
        gyro, accel : (3,) or (n, 3) array_like
            Angular rate [rad/s] and specific force [m/s^2] in body axes, or increments; see `insnav.ImuData`.

        Raises
        ------
        InputError
            The samples have another shape, are not finite, or go back in time. None of them is used.
        DivergenceError
            The filter lost consistency.
        """
        times = np.array(time, dtype=np.float64, ndmin=1)
        arrays = [_array(name, each, (times.size, 3)) for name, each in (("gyro", gyro), ("accel", accel))]
        _array("time", times, (times.size,))
        back = np.flatnonzero(np.diff(times, prepend=self._last) <= 0.0)
        if back.size:
            before = times[back[0] - 1] if back[0] else self._last
            raise InputError("online.time_back", where="imu", time_s=times[back[0]], before_s=before)
        if not times.size:
            return
        block = ImuData(times, *arrays, *self._how)
        for rows in spans(block) if times[-1] - times[0] > LONGEST_GAP else [slice(None)]:
            self._take(block.rows(rows))

    def gps(
        self,
        time: float,
        lla: ArrayLike,
        v_n: ArrayLike | None = None,
        sd: ArrayLike | None = None,
        fix: int | None = None,
    ) -> None:
        """Take a fix; a late fix is used as if it had been on time.

        Parameters
        ----------
        time : float
            Time of the fix [s].
        lla : (3,) array_like
            Latitude, longitude [rad], ellipsoidal height [m] of the antenna.
        v_n : (3,) array_like, optional
            Velocity North, East, Down [m/s]; ``NaN`` where not known.
        sd : (3,) or (6,) array_like, optional
            Standard deviation of the position North, East, Down [m], and of the velocity [m/s]; ``NaN`` where not
            known. By default that of a stand-alone receiver: 1.5, 1.5, 3 m and 0.2, 0.2, 0.3 m/s.
        fix : int, optional
            Fix type: 1 fixed, 2 float, 4 DGPS, 5 single, 0 none.

        Raises
        ------
        InputError
            The fix has another shape, is not finite, or is not in radians. It is not used.
        """
        at, place = float(_array("time", time, ())), _array("lla", lla, (3,))
        if abs(place[0]) > 0.5 * np.pi or abs(place[1]) > 2.0 * np.pi:
            raise InputError("online.not_radians", where="gps", lla=tuple(place))
        given = np.full(6, np.nan)
        if sd is not None:
            size = 6 if np.size(sd) == 6 else 3
            given[:size] = _array("sd", sd, (size,), known=False)
            if not (given[~np.isnan(given)] > 0.0).all():
                raise InputError("online.not_an_sd", where="gps", sd=tuple(given[:size]))
        velocity = np.full(3, np.nan) if v_n is None else _array("v_n", v_n, (3,), known=False)
        rows = [np.array(each, ndmin=2) for each in (place, velocity, given[:3], given[3:])]
        kind = None if fix is None else np.array([fix])
        found = with_sd(GpsData(np.array([at]), *rows, kind))[0]
        at -= self._settings.delay
        number = sum(each <= at + strapdown.TIME_TOLERANCE for each, _ in self._fixes)
        repeated = number and self._fixes[number - 1][0] >= at - strapdown.TIME_TOLERANCE
        late = self._last - at
        if repeated or (self._saved and (late > WINDOW or at <= self._saved[0][0] + strapdown.TIME_TOLERANCE)):
            code = Code.ONLINE_FIX_REPEATED if repeated else Code.ONLINE_FIX_LATE
            self._record.event(Finding.of(code, at, subject="gps", late_s=late, limit_s=WINDOW))
            return
        self._fixes.insert(number, (at, found))
        if self._aligning or self._nav is None:
            return
        if at <= self._nav.done + strapdown.TIME_TOLERANCE:
            self._repeat(at)
        else:
            self._nav.take_fixes(self._gps())

    @property
    def state(self) -> OnlineState:
        """State at the newest sample that the filter has processed."""
        nav, findings = self._nav, self._record.found
        if nav is None or self._aligning:
            aligning = Finding.of(Code.ONLINE_ALIGNING, self._last, cause=self._cause or "")
            return OnlineState(findings=(*findings, aligning))
        now, p = nav.estimate, nav.estimate.covariance_now
        rph, variance, sd = rph_from_quat(now.x[6:])[None], np.empty((1, 12)), np.empty((1, 9))
        variances(p, now.x, variance[0])
        deviations(np.array([nav.done]), np.zeros(1, np.int64), variance, self._axes_sd, rph, sd)
        parts = (now.x[:3], now.x[3:6], rph[0], now.correction[:3], now.correction[3:6], p[:STATES, :STATES], sd[0])
        delay = self._settings.delay + now.delay
        return OnlineState(True, nav.done, *(each.copy() for each in (*parts, now.lever)), delay, tuple(findings))

    def _take(self, some: ImuData) -> None:
        """Take samples without a long gap between them."""
        before, self._last = self._last, float(some.time[-1])
        gap = float(some.time[0]) - before
        if np.inf > gap > LONGEST_GAP:
            if not self._aligning:
                self._ended = before
            self._aligning, self._held, self._saved, self._recent = True, [], [], []
            self._fixes = [each for each in self._fixes if each[0] > before]
            self._record.event(Finding.of(Code.ONLINE_GAP, before, before + gap, gap_s=gap, limit_s=LONGEST_GAP))
        if not self._aligning:
            self._process(some)
            return
        self._held.append(some)
        if self._last >= self._retry and self._fixes:
            self._retry = self._last + RETRY
            self._held = [_joined(self._held)]
            self._align(self._held[0])

    def _align(self, held: ImuData) -> None:
        """Align with the samples since the start, or since a gap, if they are sufficient; navigate them."""
        gps, begin, first = self._gps(), float(held.time[0]), self._nav is None
        start = self._start if first and isinstance(self._start, Start) else None
        until = np.inf if self._static is None else self._static[1]
        moving = None if start is not None else sure_motion(gps, begin)[1]
        if start is not None:
            until = start.time + APART
        elif moving is not None:
            until = moving - self._settings.delay + AFTER
        if self._last < until or (self._nominal is None and self._last - begin < SHORTEST):
            return
        try:
            ready = prepare(
                *(held, gps, self._spec, self._settings),
                states=self._states,
                start=start,
                static_span=self._static,
                heading=self._heading if first else None,
                nominal=self._nominal,
                as_given=True,
            )
        except AlignmentError as error:
            self._cause = error.facts
            if moving is not None:  # begin again with later data
                self._held = [held.rows(held.time > until)]
            return
        self._aligning, self._held, self._nominal = False, [], ready.nominal
        start, sd = ready.initial.time, ready.alignment.sd
        methods = (ready.alignment.level_method, sd[:2].max()), (ready.alignment.heading_method, sd[2])
        for each in (*ready.findings, *(Finding.of(Code(how), start, sd_rad=size) for how, size in methods)):
            self._record.event(each)
        if self._nav is None:
            self._nav, self._axes_sd = ready.navigator(record=self._record), ready.model.axes_sd
            self._saved = [(self._nav.done, -np.inf, self._nav.saved())]
        else:
            self._nav.restart_at(Part(self._ended, ready.alignment, ready.initial))
            self._nav.take_fixes(gps)
        self._process(ready.imu)

    def _gps(self) -> GpsData:
        """Return the fixes in order of time."""
        rows = [fix for _, fix in self._fixes] or [
            GpsData(np.empty(0), *(np.empty((0, 3)) for _ in range(4)))
        ]
        kinds = [np.array([5]) if each.fix is None else each.fix for each in rows]
        fields = zip(*((each.time, each.lla, each.v_n, each.position_sd, each.velocity_sd) for each in rows), strict=True)
        return GpsData(*map(np.concatenate, fields), np.concatenate(kinds))

    def _process(self, some: ImuData) -> None:
        """Navigate samples, and keep states to go back to."""
        assert self._nav is not None
        nav, blocks = self._nav, [some]
        if some.time[-1] - some.time[0] > APART:
            edges = [0, *(np.flatnonzero(np.diff(some.time // APART)) + 1).tolist(), None]
            blocks = [some.rows(slice(*each)) for each in pairwise(edges)]
        for block in blocks:
            nav.feed(block)
            self._recent.append(block)
            if not self._saved or nav.done >= self._saved[-1][0] + APART:
                self._saved.append((nav.done, float(block.time[-1]), nav.saved()))
                while len(self._saved) > 1 and self._saved[1][0] < self._last - WINDOW:
                    del self._saved[0]
                self._recent = [each for each in self._recent if each.time[-1] > self._saved[0][1]]
                self._fixes = [each for each in self._fixes if each[0] > self._saved[0][0]]

    def _repeat(self, time: float) -> None:
        """Go back to before a time [s], and navigate the samples since with all fixes."""
        assert self._nav is not None
        while self._saved[-1][0] + strapdown.TIME_TOLERANCE >= time:
            del self._saved[-1]
        done, newest, state = self._saved[-1]
        self._record.found = [each for each in self._record.found if not each.begin > done]
        self._nav.go_back(state, self._gps())
        after = [each for each in self._recent if each.time[-1] > newest]
        self._recent = self._recent[: -len(after)]
        self._process(_joined(after))


def _joined(blocks: list[ImuData]) -> ImuData:
    time, gyro, accel = (np.concatenate([getattr(each, name) for each in blocks]) for name in ("time", "gyro", "accel"))
    return replace(blocks[0], time=time, gyro=gyro, accel=accel)


def _array(name: str, values: ArrayLike, shape: tuple[int, ...], *, known: bool = True) -> FloatArray:
    """Copy finite numbers, or all if not `known`, of a given shape; one row may be without its first dimension."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("online.not_numbers", where=name, reason=str(error)) from error
    if array.shape != shape and (array.shape != shape[1:] or shape[:1] != (1,)):
        raise InputError("online.shape", where=name, shape=array.shape, wanted=shape)
    if known and not np.isfinite(array).all():
        raise InputError("online.not_finite", where=name, count=int((~np.isfinite(array)).sum()))
    return array.reshape(shape)
