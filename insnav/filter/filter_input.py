"""Input of the filter: data, error model, starts, receiver, aiding, known faults of the recording, and outputs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from insnav import strapdown
from insnav.alignment.align import away
from insnav.alignment.static import LONG_REST
from insnav.filter.error_model import ErrorModel, InitialState, Part, error_model
from insnav.filter.gates import Gates
from insnav.filter.gps_noise import OPEN_SD, CorrelatedNoise, Rough
from insnav.filter.measurements.measurement import Measurement
from insnav.filter.measurements.sensors import HeightAiding
from insnav.filter.noise_estimate import NoiseEstimate, start_by
from insnav.filter.receiver import Receiver
from insnav.types import Alignment, BoolArray, FloatArray, GpsData, ImuData, RoundingChange, SensorLog, StateChange

LONGEST_REST = 3600.0  # longest stationary start that is searched for [s]


@dataclass(frozen=True, slots=True)
class Aiding:
    """Aiding measurements: all measurements except the fixes."""

    measurements: tuple[Measurement, ...] | None = None  # in the order of use; None: not yet determined
    logs: tuple[SensorLog, ...] = ()  # of further sensors; a first pass over the drive calibrates them as measurements


@dataclass(frozen=True, slots=True)
class Output:
    """Outputs of a filter run."""

    interval: float = 0.1  # between rows of the solution [s]; 0 for every sample
    smooth: bool = True  # run the smoother at the end; see `insnav.filter.smoother`
    epochs: FloatArray = field(default_factory=lambda: np.empty(0))  # additional output times, increasing [s]
    point_b: FloatArray | None = None  # output point of the poses seen from the IMU, body axes, (3,) [m]

    @property
    def with_poses(self) -> bool:
        """Test whether poses are wanted: the solution at `epochs`, or of the point `point_b`."""
        return self.epochs.size > 0 or self.point_b is not None


@dataclass(frozen=True, slots=True)
class Explained:
    """Known faults of the recording, which the filter corrects; see `insnav.explain.explanation`."""

    changes: tuple[StateChange, ...] = ()  # changes of the filter state, in order of time
    false: BoolArray | None = None  # (2, n) positions and velocities to exclude
    rough: tuple[Rough, ...] = ()  # intervals with larger time-correlated position errors


@dataclass(frozen=True, slots=True)
class FilterInput:
    """Recording that is aligned and ready for the filter."""

    imu: ImuData  # samples of the IMU, after calibration
    gps: GpsData  # fixes, with a standard deviation for every value
    model: ErrorModel  # noise of the sensors and of their errors
    starts: tuple[Part, ...]  # the first start, and a restart after each long gap of the samples
    nominal: float  # nominal sampling interval of the IMU [s]
    receiver: Receiver = field(default_factory=Receiver)  # lever arm, delay and errors
    gates: Gates = field(default_factory=Gates)
    aiding: Aiding = field(default=Aiding())
    output: Output = field(default_factory=Output)
    explained: Explained = field(default=Explained())
    rounding: tuple[RoundingChange, ...] = ()  # changes of the rounding error of coarse gyros, in order of time

    @property
    def alignment(self) -> Alignment:
        """Initial attitude."""
        return self.starts[0].alignment

    @property
    def initial(self) -> InitialState:
        """Initial state."""
        return self.starts[0].initial

    @property
    def fix_time(self) -> FloatArray:
        """Times at which the fixes are valid: timestamps minus the specified delay, (n,) [s]."""
        return self.gps.time - self.receiver.delay.value

    def replace_start(self, alignment: Alignment, initial: InitialState) -> FilterInput:
        """Copy with another start."""
        return replace(self, starts=(Part(self.starts[0].after, alignment, initial), *self.starts[1:]))

    def replace_correlated(self, noise: CorrelatedNoise | None) -> FilterInput:
        """Copy with another time-correlated part of the position errors."""
        return replace(self, receiver=replace(self.receiver, correlated=noise))

    def replace_aiding(self, measurements: Iterable[Measurement]) -> FilterInput:
        """Copy with other measurements besides the fixes."""
        return replace(self, aiding=replace(self.aiding, measurements=tuple(measurements)))

    def keep_history(self) -> FilterInput:
        """Copy without aiding and with few outputs, for a run of which only the history of epochs is needed."""
        return replace(self, aiding=Aiding(), output=Output(10.0))

    def hold_height(self, sd: float) -> FilterInput:
        """Copy with a constraint of the height to the height of the start, with standard deviation `sd` [m]."""
        level = HeightAiding(np.array([self.initial.time]), self.initial.lla[2:], np.array([sd]))
        return self.replace_aiding([level])

    def unbroken_until(self, time: float) -> float:
        """Return the end of the part of the record, between long gaps, that contains `time` [s]."""
        return min((part.after for part in self.starts[1:] if part.after >= time), default=float(self.imu.time[-1]))

    def longest_part(self) -> FilterInput:
        """Copy with the samples of the longest part between long gaps only."""
        if len(self.starts) == 1:
            return self
        ends = [*(part.after for part in self.starts[1:]), float(self.imu.time[-1])]
        longest = int(np.argmax([end - part.initial.time for part, end in zip(self.starts, ends, strict=True)]))
        begin = -np.inf if longest == 0 else ends[longest - 1]
        rows = (self.imu.time > begin) & (self.imu.time <= ends[longest])
        return replace(self, imu=self.imu.rows(rows), starts=self.starts[longest : longest + 1])

    def apply_noise(self, found: NoiseEstimate) -> FilterInput:
        """Return a copy with the estimated noise. The samples are not corrected for misalignments."""
        model = error_model(found.filter_spec, self.model.states)
        scaled = self.scale_sds(model, found.position_factor, found.velocity_factor)
        return replace(scaled.replace_correlated(found.correlated), model=model)

    def scale_sds(self, model: ErrorModel, position: FloatArray, velocity: FloatArray) -> FilterInput:
        """Scale sds of fixes by factors `position` and `velocity` (3,), and adapt the starts to them and to `model`."""
        position_sd = self.gps.position_sd * np.where(self.gps.position_sd < OPEN_SD, position, 1.0)
        gps = replace(self.gps, position_sd=position_sd, velocity_sd=self.gps.velocity_sd * velocity)
        states = (start_by(part.initial, part.alignment, model, position) for part in self.starts)
        starts = tuple(replace(part, initial=each) for part, each in zip(self.starts, states, strict=True))
        return replace(self, gps=gps, starts=starts)

    def first(self, length: float) -> ImuData:
        """Return the samples up to `length` [s] after the start or, if it is long, after the stationary start."""
        begin, time = self.initial.time, self.gps.time - self.initial.time
        gps = self.gps.rows(np.flatnonzero((time > 0.0) & (time < LONGEST_REST)))
        away_rows = np.flatnonzero(away(gps, gps.lla[0])) if gps.time.size else gps.time
        rest = float(gps.time[away_rows[0]] - begin) if away_rows.size else 0.0
        until = begin + (rest if rest > LONG_REST else 0.0) + length
        return self.imu.rows(slice(int(np.searchsorted(self.imu.time, until, side="right"))))  # no copy

    def beginning(self, length: float) -> FilterInput:
        """Copy the first `length` [s] of the longest part, for searches. Join samples, unless some are missing."""
        part = self.longest_part()
        imu = part.first(length)
        part = replace(part, imu=imu)
        samples = strapdown.joined([strapdown.intervals(imu, self.nominal)])
        if samples.gap.any() or samples.end.shape[0] == imu.time.shape[0]:
            return part
        imu = ImuData(samples.end, samples.gyro, samples.accel, "increment")
        return replace(part, imu=imu, nominal=strapdown.nominal_interval(imu.time))
