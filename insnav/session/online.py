"""Online filter: it processes data as they arrive, with the kernels and measurements of `insnav.filter.navigator`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from insnav import strapdown
from insnav.alignment.in_motion import first_motion, velocity
from insnav.attitude import rph_from_quat
from insnav.exceptions import AlignmentError, ConfigError, InputError
from insnav.filter.error_model import Part
from insnav.filter.filter_input import Output
from insnav.filter.gps_noise import DEFAULT_POSITION, DEFAULT_VELOCITY, LARGEST_SHARE, CorrelatedNoise, with_sd
from insnav.filter.navigator import COAST, Navigator
from insnav.filter.prepare import AFTER, LONGEST_GAP, SHORTEST, GivenStart, Start, prepare, spans
from insnav.filter.run_recorder import ROOM, Record
from insnav.findings import Code, ErrorFacts, Finding
from insnav.imu.specification import ImuSpec
from insnav.kernels.errorstate import STATES, Outputs, variances
from insnav.kernels.output import deviations
from insnav.steps.given import checked, given_imu, given_receiver, one_of
from insnav.steps.inputs import Inputs
from insnav.types import FloatArray, GpsData, ImuData

WINDOW = 2.0  # fixes are ignored if they are older than this, relative to the newest sample [s]
INPUTS = ("lever_arm", "lever_arm_sd", "gps_delay", "heading", "static", "initial", "sampling", "stamp", "rate")


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
        Covariance of the errors, estimate minus truth. Position N, E, D [m], velocity N, E, D [m/s], attitude ``phi``
        [rad]. Gyro bias [rad/s], accelerometer bias [m/s^2], gyro and accelerometer scale factor [-].
    sd : (9,) array
        Standard deviation of position N, E, D [m], velocity N, E, D [m/s], roll, pitch, heading [rad].
    lever_arm : (3,) array
        Antenna position relative to the IMU, body axes, specified or estimated [m].
    gps_delay : float
        Age of the fixes relative to their timestamps, specified or estimated [s].
    findings : tuple of Finding
        The newest findings, at most 4096, in the order of their detection.
    """

    aligned: bool
    time: float
    lla: FloatArray
    v_n: FloatArray
    rph: FloatArray
    gyro_bias: FloatArray
    accel_bias: FloatArray
    covariance: FloatArray
    sd: FloatArray
    lever_arm: FloatArray
    gps_delay: float
    findings: tuple[Finding, ...]


class _Findings(Record):
    """Record of an online run: it keeps only the newest findings, and no solution."""

    def __init__(self) -> None:
        super().__init__(0)
        self.found: list[Finding] = []
        self._outputs = super().reserve(0, np.full(3, np.inf), np.empty(0))

    def event(self, event: Finding) -> None:
        self.found = [*self.found[1 - ROOM :], event]

    def reserve(self, rows: int, grid: FloatArray, wanted: FloatArray) -> Outputs:
        self._outputs.used[:] = 0
        return self._outputs

    def epoch(self, *_: Any) -> None: ...

    def fix(self, *_: Any) -> None: ...


class OnlineFilter:
    """Loosely coupled INS/GPS filter that processes data as they arrive.

    The filter collects data until they determine an attitude: until the end of `static`, or 50 s after the first
    motion. It then navigates the collected data, and each further block at once. Without motion it needs `static` and a
    heading, or gyros that measure the Earth's rotation. Fixes may arrive in any order within 2 s: the filter returns to
    an earlier state and repeats the samples since then.

    Parameters
    ----------
    imu : str, path or ImuSpec
        IMU error specification: a grade, a part, a file.
    states : {21, 15}
        With or without scale factor errors.
    correlated : (2,) sequence of float, optional
        Time-correlated errors of the positions: share of the variance of a fix [-], at most 0.95, and correlation time
        [s]. By default the errors are white, and the standard deviations are too small for most receivers.
    **inputs
        As for `insnav.load`: ``lever_arm`` and ``gps_delay`` (estimated if absent), ``lever_arm_sd``, ``heading``,
        ``static``, ``initial``, ``sampling``, ``stamp``. ``rate``: samples per second, by default their mean rate until
        the alignment [Hz].

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
        *,
        states: int = 21,
        correlated: tuple[float, float] | None = None,
        **inputs: Unpack[Inputs],
    ) -> None:
        for name in inputs:
            one_of("OnlineFilter", name, INPUTS)
        for value, high, unit in zip(correlated or (), (LARGEST_SHARE, np.inf), ("", "s"), strict=bool(correlated)):
            if not 0.0 < value <= high:
                raise ConfigError("input.out_of_range", where="correlated", value=value, low=0, high=high, unit=unit)
        inputs = checked(inputs)
        spec_and_finding, start, rate = given_imu(imu), inputs.get("initial"), inputs.get("rate")
        assert spec_and_finding is not None
        self._start = start if isinstance(start, Start) else None
        self._spec, self._heading, self._static = spec_and_finding[0], inputs.get("heading"), inputs.get("static")
        receiver = given_receiver(inputs)
        self._delay, delay = receiver.delay.value, replace(receiver.delay, value=0.0)
        self._receiver = replace(receiver, delay=delay)
        none, three = np.empty(0), np.empty((0, 3))
        self._nothing = ImuData(none, three, three, inputs.get("sampling") or "mean", inputs.get("stamp") or "end")
        self._states, self._nominal, self._correlated = states, None if rate is None else 1.0 / rate, correlated
        self._record = _Findings()
        self._record.event(spec_and_finding[1])
        self._nav: Navigator | None = None
        self._last, self._ended, self._retry = -np.inf, -np.inf, -np.inf  # newest sample, gap, next alignment [s]
        self._aligning, self._held = True, self._nothing  # samples for alignment
        # fixes since the oldest stored state
        self._gps = GpsData(none, three, three, three, three, np.empty(0, np.int64))
        self._recent: list[ImuData] = []  # samples after the oldest stored state
        self._saved: list[tuple[float, float, tuple[Any, ...]]] = []  # time of state, of newest sample, state
        self._axes_sd = np.zeros(3)
        self._cause: ErrorFacts | None = None

    def imu(self, time: ArrayLike, gyro: ArrayLike, accel: ArrayLike) -> None:
        """Process the next IMU samples.

        Parameters
        ----------
        time : float or (n,) array_like
            Time of each sample [s], increasing, also from call to call.
        gyro, accel : (3,) or (n, 3) array_like
            Angular rate [rad/s] and specific force [m/s^2] in body axes, or increments; see `insnav.ImuData`.

        Raises
        ------
        InputError
            The samples have a wrong shape, are not finite, or go back in time. None of the samples is used.
        DivergenceError
            The filter lost consistency.
        """
        times = _array("time", np.atleast_1d(time), None)
        rates, forces = _array("gyro", gyro, (times.size, 3)), _array("accel", accel, (times.size, 3))
        if times.size and not (times[0] > self._last and (times[1:] > times[:-1]).all()):
            row = int(np.flatnonzero(np.diff(times, prepend=self._last) <= 0.0)[0])
            before = times[row - 1] if row else self._last
            raise InputError("online.time_back", where="imu", time_s=times[row], before_s=before)
        block = ImuData(times, rates, forces, self._nothing.sampling, self._nothing.stamp)
        if times.size and times[-1] - times[0] <= LONGEST_GAP:
            self._take(block)
        elif times.size:
            for rows in spans(block):
                self._take(block.rows(rows))

    def gps(
        self,
        time: float,
        lla: ArrayLike,
        v_n: ArrayLike | None = None,
        sd: ArrayLike | None = None,
        fix: int | None = None,
    ) -> None:
        """Process a fix; a late fix gives the same result as a punctual fix.

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
            known. By default a stand-alone receiver is assumed: 1.5, 1.5, 3 m and 0.2, 0.2, 0.3 m/s.
        fix : int, optional
            Fix type: 1 fixed, 2 float, 4 DGPS, 5 single, 0 none.

        Raises
        ------
        InputError
            The fix has a wrong shape, is not finite, or is not in radians. The fix is not used.
        """
        fix_time, position = _array("time", np.atleast_1d(time), (1,)), _array("lla", lla, (3,))
        if abs(position[0]) > 0.5 * np.pi or abs(position[1]) > 2.0 * np.pi:
            raise InputError("online.not_radians", where="gps", lla=tuple(position))
        sds, velocity = np.array([*DEFAULT_POSITION, *DEFAULT_VELOCITY]), np.full(3, np.nan)
        if sd is not None:
            size = 6 if np.size(sd) == 6 else 3
            sds[:size] = _array("sd", sd, (size,), known=False)
            if (sds <= 0.0).any():
                raise InputError("online.not_an_sd", where="gps", sd=tuple(sds[:size]))
        if v_n is not None:
            velocity = _array("v_n", v_n, (3,), known=False)
        fix_type = np.array([5 if fix is None else fix])
        fix_time = fix_time - self._delay  # time of validity: remove the specified delay
        new = with_sd(GpsData(fix_time, position[None], velocity[None], sds[None, :3], sds[None, 3:], fix_type))[0]
        tolerance, moment, gps = strapdown.TIME_TOLERANCE, float(new.time[0]), self._gps
        first, after = gps.time.searchsorted([moment - tolerance, moment + tolerance])
        late = self._last - moment
        if first < after or (self._saved and (late > WINDOW or moment <= self._saved[0][0] + tolerance)):
            code = Code.ONLINE_FIX_REPEATED if first < after else Code.ONLINE_FIX_LATE
            self._record.event(Finding.of(code, moment, subject="gps", late_s=late, limit_s=WINDOW))
            return
        later = gps.rows(slice(first, None))
        self._gps = gps.rows(slice(first)).joined(new).joined(later) if later.time.size else gps.joined(new)
        if self._aligning or self._nav is None:
            return
        if moment <= self._nav.done + tolerance:  # the filter is already past this fix: repeat samples
            self._repeat(moment)
        else:
            self._nav.take_fixes(self._gps)

    @property
    def state(self) -> OnlineState:
        """State after the newest sample that the filter has processed."""
        nav, findings = self._nav, tuple(self._record.found)
        if nav is None or self._aligning:
            cause: dict[str, Any] = {} if self._cause is None else {"cause": self._cause}
            aligning = Finding.of(Code.ONLINE_ALIGNING, self._last, **cause)
            nine, covariance = np.full(9, np.nan), np.full((STATES, STATES), np.nan)
            three = (nine[:3],) * 5
            return OnlineState(False, np.nan, *three, covariance, nine, nine[:3], np.nan, (*findings, aligning))
        now, p = nav.estimate, nav.estimate.covariance_now
        rph, variance, sd = rph_from_quat(now.x[6:])[None], np.empty((1, 12)), np.empty((1, 9))
        variances(p, now.x, variance[0])
        deviations(np.array([nav.done]), np.zeros(1, np.int64), variance, self._axes_sd, rph, sd)
        lla, v_n, gyro_bias, accel_bias = np.split(np.concatenate([now.x[:6], now.correction[:6]]), 4)
        estimates = lla, v_n, rph[0], gyro_bias, accel_bias, p[:STATES, :STATES].copy(), sd[0], now.lever.copy()
        return OnlineState(True, nav.done, *estimates, self._delay + now.delay, findings)

    def _take(self, some: ImuData) -> None:
        """Process samples without a long gap between them; start a new alignment after a gap before them."""
        before, self._last = self._last, float(some.time[-1])
        gap = float(some.time[0]) - before
        if np.inf > gap > LONGEST_GAP:
            if not self._aligning:
                self._ended = before
            self._aligning, self._held, self._saved, self._recent = True, self._nothing, [], []  # start alignment
            self._gps = self._gps.rows(self._gps.time > before)
            self._record.event(Finding.of(Code.ONLINE_GAP, before, before + gap, gap_s=gap, limit_s=LONGEST_GAP))
        if not self._aligning:
            self._process(some)
            return
        self._recent.append(some)
        if self._last >= self._retry and self._gps.time.size:
            self._retry = self._last + COAST
            collected, self._recent = _joined([self._held, *self._recent]), []
            self._held = self._align(collected)

    def _align(self, held: ImuData) -> ImuData:
        """Align with samples since the start, or since a gap, if sufficient; return samples still needed."""
        begin, first, gps = float(held.time[0]), self._nav is None, self._gps
        if self._nominal is not None and not first:  # only fixes after the gap
            gps = gps.rows(gps.time >= begin - self._nominal)
        start, moving = self._start if first else None, None
        until = np.inf if self._static is None else self._static[1]  # time that the samples must reach
        if start is not None:
            until = start.time + COAST
        elif gps.time.size and (moving := first_motion(velocity(gps), begin)) is not None:
            until = moving + AFTER
        if self._last < until or (self._nominal is None and self._last - begin < SHORTEST) or not gps.time.size:
            return held
        receiver = self._receiver
        if self._correlated is not None:
            receiver = replace(receiver, correlated=CorrelatedNoise.of_fixes(*self._correlated, gps.position_sd))
        try:
            ready, findings = prepare(
                *(held, gps, self._spec, receiver),
                states=self._states,
                known=GivenStart(start, self._static, self._heading if first else None),
                nominal=self._nominal,
                as_given=True,
            )
        except AlignmentError as error:
            self._cause = error.facts
            return held if moving is None else held.rows(held.time > until)  # try again with later data only
        self._aligning, self._nominal, alignment = False, ready.nominal, ready.alignment
        methods = (alignment.level_method, alignment.sd[:2].max()), (alignment.heading_method, alignment.sd[2])
        for each in (*findings, *(Finding.of(Code(method), ready.initial.time, sd_rad=sd) for method, sd in methods)):
            self._record.event(each)
        if self._nav is None:
            filter_input = replace(ready, imu=self._nothing, output=Output(smooth=False))
            self._nav, self._axes_sd = Navigator(filter_input, record=self._record), ready.model.axes_sd
            self._saved = [(self._nav.done, -np.inf, self._nav.saved())]  # repeats all samples since
        else:
            self._nav.restart_at(Part(self._ended, alignment, ready.initial))
            self._nav.take_fixes(self._gps)
        self._process(ready.imu)
        return self._nothing

    def _process(self, some: ImuData) -> None:
        """Navigate samples, and store states to which `_repeat` can return."""
        assert self._nav is not None
        nav, blocks = self._nav, [some]
        if some.time[-1] - some.time[0] > COAST:
            edges = [0, *(np.flatnonzero(np.diff(some.time // COAST)) + 1).tolist(), None]  # edges at multiples
            blocks = [some.rows(slice(*each)) for each in pairwise(edges)]
        for block in blocks:
            nav.feed(block)
            self._recent.append(block)
            if not self._saved or nav.done >= self._saved[-1][0] + COAST:
                self._saved.append((nav.done, float(block.time[-1]), nav.saved()))
                while len(self._saved) > 1 and self._saved[1][0] < self._last - WINDOW:
                    del self._saved[0]  # states that no fix can require any more
                self._recent = [each for each in self._recent if each.time[-1] > self._saved[0][1]]
                self._gps = self._gps.rows(self._gps.time >= self._saved[0][0])

    def _repeat(self, time: float) -> None:
        """Return to the last state stored before a time [s], and navigate the later samples again with all fixes."""
        assert self._nav is not None
        while self._saved[-1][0] + strapdown.TIME_TOLERANCE >= time:  # discard states after this time
            del self._saved[-1]
        done, newest, state = self._saved[-1]
        findings = self._record.found
        self._record.found = [each for each in findings if each.code.startswith("online.") or not each.begin > done]
        self._nav.go_back(state, self._gps)
        after = [each for each in self._recent if each.time[-1] > newest]
        self._recent = self._recent[: -len(after)]
        self._process(_joined(after))


def _joined(blocks: list[ImuData]) -> ImuData:
    time, gyro, accel = (np.concatenate([getattr(each, name) for each in blocks]) for name in ("time", "gyro", "accel"))
    return replace(blocks[0], time=time, gyro=gyro, accel=accel)


def _array(name: str, values: ArrayLike, shape: tuple[int, ...] | None, *, known: bool = True) -> FloatArray:
    """Copy numbers, all finite if `known`, to an array of `shape`, by default (n,); one row may be one-dimensional."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("online.not_numbers", where=name, reason=str(error)) from error
    wanted = array.shape[:1] if shape is None else shape
    if array.shape != wanted and (1, *array.shape) != wanted:
        raise InputError("online.shape", where=name, shape=str(array.shape), wanted=str(wanted))
    if known and not np.isfinite(array).all():
        raise InputError("online.not_finite", where=name, count=int((~np.isfinite(array)).sum()))
    return array.reshape(wanted)
