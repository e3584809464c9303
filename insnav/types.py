"""Data types of insnav.

Measurements are float64 arrays in SI units and radians; see `insnav` for frames and signs. ``NaN`` means "unknown" in
fields documented so. No other value means "unknown".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from insnav.findings import Code, Finding
from insnav.tabular import FromTable, Tabular

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

Sampling = Literal["mean", "instant", "increment"]
Stamp = Literal["start", "mid", "end"]
Source = Literal["given", "data", "prior"]


def _each(template: str, parts: str) -> tuple[str, ...]:
    # each part replaces the question mark of the template
    return tuple(template.replace("?", part) for part in parts.split())


_GYRO, _ACCEL = _each("gyro_?_rad_s", "x y z"), _each("accel_?_m_s2", "x y z")
_DTHETA, _DVEL = _each("dtheta_?_rad", "x y z"), _each("dvel_?_m_s", "x y z")
_LLA = ("lat_deg", "lon_deg", "height_m")
_V_N, _RPH = _each("v?_m_s", "n e d"), _each("?_deg", "roll pitch heading")
_POSITION_SD, _VELOCITY_SD = _each("sd_?_m", "n e d"), _each("sd_v?_m_s", "n e d")
_SENSOR_ERRORS = (
    *_each("gyro_bias_?_deg_h", "x y z"),
    *_each("accel_bias_?_mg", "x y z"),
    *_each("gyro_scale_?_ppm", "x y z"),
    *_each("accel_scale_?_ppm", "x y z"),
)


@dataclass(frozen=True, slots=True)
class ImuData(FromTable):
    """Samples of an inertial measurement unit in body axes (Forward, Right, Down).

    Attributes
    ----------
    time : (n,) array
        Time of each sample [s], strictly increasing.
    gyro : (n, 3) array
        Angular rate of the body against inertial space [rad/s]; its integral [rad] if `sampling` is ``increment``.
    accel : (n, 3) array
        Specific force [m/s^2]; its integral [m/s] if `sampling` is ``increment``. Level and at rest z is -9.8 m/s^2.
    sampling : {"mean", "instant", "increment"}
        Samples are means over the sampling interval, values at an instant, or integrals over the interval.
    stamp : {"start", "mid", "end"}
        Point of the sampling interval that the time of a sample refers to (no meaning for ``instant``).
    temperature : (n,) array or None
        Sensor temperature [deg C].
    odometer : (n,) array or None
        Forward speed from a wheel sensor [m/s], ``NaN`` where there is none.
    baro : (n,) array or None
        Barometric height above an arbitrary zero [m]; ``NaN`` where there is none.
    """

    COLUMNS: ClassVar = {
        "time": ("time_s",),
        "gyro": _GYRO,
        "accel": _ACCEL,
        "temperature": ("temperature_c",),
        "odometer": ("odometer_m_s",),
        "baro": ("baro_height_m",),
    }
    NEEDED: ClassVar = ("time", "gyro", "accel")

    time: FloatArray
    gyro: FloatArray
    accel: FloatArray
    sampling: Sampling = "mean"
    stamp: Stamp = "end"
    temperature: FloatArray | None = None
    odometer: FloatArray | None = None
    baro: FloatArray | None = None

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return canonical columns ``(n,)``; columns of increments have their own names."""
        names = dict(zip(_GYRO + _ACCEL, _DTHETA + _DVEL, strict=True)) if self.sampling == "increment" else {}
        return {names.get(name, name): column for name, column in Tabular.columns(self).items()}

    def beginning(self, length: float) -> ImuData:
        """Return the samples of the first `length` [s]."""
        return self.rows(slice(int(np.searchsorted(self.time, self.time[0] + length))))

    @classmethod
    def from_frame(cls, frame: pd.DataFrame, **others: str) -> Self:
        """Read a table as `insnav.tabular.FromTable.from_frame` does; its columns are rates or increments."""
        if _DTHETA[0] in frame.columns:
            frame = frame.rename(columns=dict(zip(_DTHETA + _DVEL, _GYRO + _ACCEL, strict=True)))
            others["sampling"] = "increment"
        return super(ImuData, cls).from_frame(frame, **others)


@dataclass(frozen=True, slots=True)
class GpsData(FromTable):
    """Fixes of a satellite receiver, at the antenna.

    Attributes
    ----------
    time : (n,) array
        Time of each fix [s], strictly increasing.
    lla : (n, 3) array
        Latitude [rad], longitude [rad], height [m].
    v_n : (n, 3) array
        Velocity North, East, Down [m/s]; ``NaN`` where not known.
    position_sd : (n, 3) array
        Standard deviation of the position North, East, Down [m]; ``NaN`` where not known.
    velocity_sd : (n, 3) array
        Standard deviation of the velocity [m/s]; ``NaN`` where not known.
    fix : (n,) array or None
        Fix type as in the file (1 fixed, 2 float, 4 DGPS, 5 single, 0 none), if given.
    heading : (n,) array or None
        Heading from the receiver, e.g. with two antennas [rad]; ``NaN`` where not known.
    satellites, dop : (n,) array or None
        Number of satellites used and dilution of precision [-], only for display; ``NaN`` where not known.
    """

    COLUMNS: ClassVar = {
        "time": ("time_s",),
        "lla": _LLA,
        "v_n": _V_N,
        "position_sd": _POSITION_SD,
        "velocity_sd": _VELOCITY_SD,
        "fix": ("fix",),
        "heading": ("heading_deg",),
        "satellites": ("satellites",),
        "dop": ("dop",),
    }

    time: FloatArray
    lla: FloatArray
    v_n: FloatArray
    position_sd: FloatArray
    velocity_sd: FloatArray
    fix: IntArray | None = None
    heading: FloatArray | None = None
    satellites: FloatArray | None = None
    dop: FloatArray | None = None

    @property
    def valid(self) -> BoolArray:
        """Return whether each fix is valid by its type, (n,)."""
        return np.ones(self.time.size, dtype=np.bool_) if self.fix is None else np.asarray(self.fix != 0)


@dataclass(frozen=True, slots=True)
class Trajectory(FromTable):
    """Position, velocity and attitude over time, at the IMU unless stated otherwise.

    Attributes
    ----------
    time : (n,) array
        Time [s], strictly increasing.
    lla : (n, 3) array
        Latitude [rad], longitude [rad], ellipsoidal height [m].
    v_n : (n, 3) array
        Velocity North, East, Down [m/s]; ``NaN`` where not known.
    rph : (n, 3) array
        Roll, pitch, heading [rad], heading in [0, 2 pi); ``NaN`` where not known.
    sd : (n, 9) array or None
        Standard deviation of position N, E, D [m], velocity N, E, D [m/s] and attitude error roll, pitch,
        heading [rad].
    """

    COLUMNS: ClassVar = {
        "time": ("time_s",),
        "lla": _LLA,
        "v_n": _V_N,
        "rph": _RPH,
        "sd": (*_POSITION_SD, *_VELOCITY_SD, *_each("sd_?_deg", "roll pitch heading")),
    }

    time: FloatArray
    lla: FloatArray
    v_n: FloatArray
    rph: FloatArray
    sd: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class SensorLog:
    """Log of an additional sensor, with times of its own clock."""

    name: str  # kind of sensor, such as ``speedometer``
    time: FloatArray  # (n,) [s], strictly increasing
    values: Mapping[str, FloatArray]  # (n,) columns by name, in SI and radians; ``NaN`` if unknown


@dataclass(frozen=True, slots=True)
class Increments(Tabular):
    """Integrated angular rate and specific force over successive intervals, with high-order corrections.

    Attributes
    ----------
    time : (n,) array
        End of each interval [s].
    dt : (n,) array
        Length of each interval [s].
    dtheta : (n, 3) array
        Integral of the body rate over the interval [rad].
    dvel : (n, 3) array
        Integral of the measured specific force over the interval [m/s].
    coning : (n, 3) array
        Rotation vector of the interval minus `dtheta` [rad].
    sculling : (n, 3) array
        Velocity increment in the body axes at the interval's start, minus its value for constant rate and specific
        force [m/s]. This value is `dvel` plus the rotation correction from `dtheta`.
    """

    COLUMNS: ClassVar = {
        "time": ("time_s",),
        "dt": ("dt_s",),
        "dtheta": _DTHETA,
        "dvel": _DVEL,
        "coning": _each("coning_?_rad", "x y z"),
        "sculling": _each("sculling_?_m_s", "x y z"),
    }

    time: FloatArray
    dt: FloatArray
    dtheta: FloatArray
    dvel: FloatArray
    coning: FloatArray
    sculling: FloatArray


@dataclass(frozen=True, slots=True)
class Alignment:
    """Attitude of the body at one time, with its uncertainty and the methods that gave it."""

    time: float  # time of this attitude [s]
    rph: FloatArray  # (3,) roll, pitch, heading [rad]
    sd: FloatArray  # (3,) standard deviation of the attitude error about North, East, Down [rad]
    # (3,) gyro bias: mean rate while stationary minus the Earth rate, and its standard deviation [rad/s]. Zero and
    # infinite if the IMU was never stationary
    gyro_bias: FloatArray
    gyro_bias_sd: FloatArray
    static: tuple[float, float] | None  # start and end of the static interval used [s]
    # methods that gave roll and pitch, and heading; a text instead of a code in folders of earlier versions
    level_method: Code | str
    heading_method: Code | str
    # (k, 2) level and heading changes between parts of a long stationary period, including sensor drift [rad]. Examples
    # are a moored boat, and a car being loaded. NaN where people board; empty for a short period
    sway: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    left: float = -np.inf  # end of this stationary period, which begins with `static` [s]


@dataclass(frozen=True, slots=True)
class Innovations(Tabular):
    """Innovation statistics of every fix that the filter processed.

    Columns 0..2 are position North, East, Down [m], 3..5 velocity North, East, Down [m/s]; ``NaN`` where the fix has
    no such measurement.
    """

    COLUMNS: ClassVar = {
        "time": ("time_s",),
        "innovation": (*_each("innovation_?_m", "n e d"), *_each("innovation_v?_m_s", "n e d")),
        "sd": (*_POSITION_SD, *_VELOCITY_SD),
        "nis_position": ("nis_position",),
        "nis_velocity": ("nis_velocity",),
        "used_position": ("used_position",),
        "used_velocity": ("used_velocity",),
    }

    time: FloatArray  # (m,) time of the fix, corrected for its delay [s]
    innovation: FloatArray  # (m, 6) measured minus predicted
    sd: FloatArray  # (m, 6) predicted standard deviation of the innovation
    # (m,) normalised innovation squared, 3 degrees of freedom each [-]
    nis_position: FloatArray
    nis_velocity: FloatArray
    # (m,) whether the filter accepted position and velocity
    used_position: BoolArray
    used_velocity: BoolArray


@dataclass(frozen=True, slots=True)
class AidingUse:
    """Innovation statistics of one kind of aiding measurement."""

    name: str  # kind, such as ``nhc``, ``zupt``, ``odometer``, ``height``, ``heading``
    # numbers of processed and of rejected measurements
    processed: int
    rejected: int
    innovation_rms: float  # RMS of accepted measurements, over at most the first three components [`unit`]
    nis: float  # mean normalised innovation squared of accepted measurements, per component [-]
    unit: str


@dataclass(frozen=True, slots=True)
class SensorErrors(Tabular):
    """Estimated sensor errors over time, with standard deviations."""

    COLUMNS: ClassVar = {
        "time": ("time_s",),
        "value": _SENSOR_ERRORS,
        "sd": tuple(f"sd_{name}" for name in _SENSOR_ERRORS),
    }

    time: FloatArray  # (m,) time of the epoch [s]
    # (m, 12) sensor errors, and their standard deviations. Axes x, y, z of: gyro bias [rad/s], accelerometer bias
    # [m/s^2], gyro scale factor [-], accelerometer scale factor [-]
    value: FloatArray
    sd: FloatArray


@dataclass(frozen=True, slots=True)
class Epochs(Tabular):
    """State and covariance after each filter epoch."""

    COLUMNS: ClassVar = {
        "time": ("time_s",),
        "lla": _LLA,
        "v_n": _V_N,
        "q_nb": ("q_w", "q_x", "q_y", "q_z"),
        "covariance": (*_POSITION_SD, *_VELOCITY_SD, *_each("sd_phi_?_deg", "n e d")),
    }

    time: FloatArray  # (m,) time of the epoch [s]
    lla: FloatArray  # (m, 3) latitude, longitude [rad], height [m]
    v_n: FloatArray  # (m, 3) velocity North, East, Down [m/s]
    q_nb: FloatArray  # (m, 4) attitude quaternion, scalar first
    # (m, 9, 9) of position N, E, D [m], velocity N, E, D [m/s] and attitude error ``phi`` [rad]. The estimated attitude
    # of the sensor axes is ``C_hat = (I - [phi x]) C``, with the true attitude ``C``
    covariance: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class StateChange:
    """Change of three error states of the filter at one time."""

    time: float  # time of the epoch after the change [s], on the clock of the samples
    first: int  # index of the first of the three error states
    change: FloatArray  # (3,) change of the error, estimate minus truth
    variance: FloatArray  # (3,) smallest error variance after the change


class RoundingChange(NamedTuple):
    """Change of the rounding errors of gyros with coarse resolution."""

    time: float  # time of the epoch after the change [s], on the clock of the samples
    before: FloatArray  # (3,) variance of each gyro's rounding error before the change [rad^2/s^2]; NaN if unchanged
    after: FloatArray  # (3,) variance of rounding errors after the change; zero where noise averages them


@dataclass(frozen=True, slots=True)
class Smoothed:
    """Smoothed (RTS) solution: each epoch uses the whole recording, including later fixes."""

    solution: Trajectory  # at the times of the filter's solution
    epochs: Epochs  # state and covariance at each used fix
    sensor_errors: SensorErrors  # biases and scale factors at the times of `epochs`


@dataclass(frozen=True, slots=True)
class Run:
    """Result of the filter for one recording.

    Attributes
    ----------
    solution : Trajectory
        Position, velocity, attitude at the IMU, with standard deviations.
    innovations : Innovations
        Innovation statistics of every fix that the filter processed.
    sensor_errors : SensorErrors
        Estimated biases and scale factors.
    events : tuple of Finding
        Unusual events, in order of time.
    alignment : Alignment
        Initial attitude of the filter.
    epochs : Epochs
        State and full covariance after each fix.
    gps_delay, gps_delay_sd : float
        Age of a fix at its timestamp [s], specified or estimated, and its standard deviation.
    lever_b, lever_sd : (3,) array
        Lever arm: vector from the IMU to the antenna, body axes [m], specified or estimated; standard deviation.
    smoothed : Smoothed or None
        The smoothed solution, if any.
    aiding : tuple of AidingUse
        Innovation statistics of aiding measurements other than fixes.
    poses : Trajectory or None
        Best solution at the requested epochs, for the requested point of the vehicle.
    lever_sd_alone : (3,) array
        `lever_sd` of the filter alone [m]. `lever_sd` also covers parts of the drive that disagree on the delay and
        thus on the lever arm.
    """

    solution: Trajectory
    innovations: Innovations
    sensor_errors: SensorErrors
    events: tuple[Finding, ...]
    alignment: Alignment
    epochs: Epochs
    gps_delay: float = 0.0
    gps_delay_sd: float = 0.0
    lever_b: FloatArray = field(default_factory=lambda: np.zeros(3))
    lever_sd: FloatArray = field(default_factory=lambda: np.zeros(3))
    smoothed: Smoothed | None = None
    aiding: tuple[AidingUse, ...] = ()
    poses: Trajectory | None = None
    lever_sd_alone: FloatArray = field(default_factory=lambda: np.zeros(3))
