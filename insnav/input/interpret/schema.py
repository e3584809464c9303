"""What the columns of data files are called: canonical names, common spellings, and spellings of units.

Spellings are compared in compact form (see `compact`): ``gyro_x``, ``GyroX`` and ``gyro.x`` are one.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from insnav.units import DEG, G0, UNITS

_LETTERS = str.maketrans({"²": "2", "³": "3", "°": "deg", "µ": "u", "μ": "u", "ω": "omega", "θ": "theta", "Δ": "d"})


def compact(text: str) -> str:
    """Lower-case letters and digits of a text: what two spellings of one name have in common.

    Examples
    --------
    >>> compact("Gyro_X"), compact("m/s²")
    ('gyrox', 'ms2')
    """
    return re.sub(r"[^a-z0-9]", "", text.translate(_LETTERS).lower())


@dataclass(frozen=True, slots=True)
class Quantity:
    """One thing that a column can hold."""

    key: str  # name without unit, such as ``gyro_x``
    name: str  # canonical column name, such as ``gyro_x_rad_s``
    dimension: str  # dimension of its unit as in `insnav.units.UNITS`, ``temperature``, or empty for a plain number
    unit: str  # unit of the canonical name
    spellings: tuple[str, ...]  # compact spellings, the most trustworthy first


_AXES = ("x", "y", "z")

_GYRO = (
    "gyro? gyr? gyroscope? angularvelocity? angularrate? angvel? angrate? rotationrate? rotrate? omega? w? "
    "wibb? g? bodyrate? turnrate? gyrorad? wrss? gyrorotation? "
    "?gyro ?gyr ?rate ?angularvelocity ?angularrate ?rotationrate rate?"
)
_ACCEL = (
    "accel? acc? acceleration? accelerometer? linearacceleration? linacc? specificforce? specforce? f? a? "
    "fibb? accelerometerms2? arss? accelerometeracceleration? ?accel ?acc ?acceleration ?accelerometer"
)
_DTHETA = "dtheta? deltatheta? deltaangle? delangle? dangle? dang? dth? incgyro? gyroinc? ?dtheta ?deltaangle"
_DVEL = "dvel? deltavel? deltavelocity? delvel? dv? deltav? incaccel? accelinc? accinc? ?dvel ?deltavelocity"
_TIME = (
    "time t timestamp ts gpstime gpst tgps timegps epoch sow tow gpssow gpstow secondsofweek timeofweek itow "
    "loggingtime timesince1970 "
    "sod unixtime unix systime systemtime elapsed elapsedtime headerstamp stamp clock seconds secs sec"
)
_FORWARD_SPEED = "odometer odometerspeed odo wheelspeed odospeed vehiclespeed forwardspeed"

_LAT = "lat latitude geodeticlatitude latgps"
_LON = "lon lng long longitude longps"
_HEIGHT = "height ellipsoidalheight heightellipsoidal hell hae alt altitude hgt h elevation elev ellh"
_HEIGHT_MSL = "heightmsl hmsl altmsl mslheight mslaltitude altitudemsl mslalt msl orthometricheight amsl"


def _spread(spellings: str, mark: str) -> tuple[str, ...]:
    return tuple(word.replace("?", mark) for word in spellings.split())


def _axes(
    key: str, dimension: str, unit: str, suffix: str, spellings: str, own: tuple[str, str, str] = ("", "", "")
) -> tuple[Quantity, ...]:
    """One quantity for each of x, y, z; arrays written as ``gyro[0]`` count 0, 1, 2; `own`: further names of each."""
    return tuple(
        Quantity(
            f"{key}_{axis}",
            f"{key}_{axis}_{suffix}".rstrip("_"),
            dimension,
            unit,
            _spread(spellings, axis) + _spread(spellings, str(i)) + tuple(own[i].split()),
        )
        for i, axis in enumerate(_AXES)
    )


def _one(key: str, name: str, dimension: str, unit: str, spellings: str) -> Quantity:
    return Quantity(key, name, dimension, unit, tuple(spellings.split()))


def _ned(key: str, name: str, dimension: str, unit: str, directions: str, templates: str) -> Quantity:
    words = tuple(word for direction in directions.split() for word in _spread(templates, direction))
    return Quantity(key, name, dimension, unit, words)


_TIME_COLUMN = _one("time", "time_s", "time", "s", _TIME)
# parts of the time that stand in columns of their own
TIME_PARTS = (
    _one("date", "date", "", "", "date utcdate dateutc gpsdate"),
    _one("time_fraction", "time_fraction_ns", "time", "ns", "nsec nsecs nanosec stampnsecs stampnsec stampnanosec "
         "headerstampnsecs headerstampnsec headerstampnanosec"),
)  # fmt: skip
_POSITION = (
    _one("lat", "lat_deg", "angle", "deg", _LAT),
    _one("lon", "lon_deg", "angle", "deg", _LON),
    _one("height", "height_m", "length", "m", _HEIGHT),
    _one("height_msl", "height_msl_m", "length", "m", _HEIGHT_MSL),
)
_V = "v? vel? velocity? speed? ?vel ?velocity v?n vned?"
_VELOCITY = (
    _ned("vn", "vn_m_s", "velocity", "m/s", "n north", _V),
    _ned("ve", "ve_m_s", "velocity", "m/s", "e east", _V),
    _ned("vd", "vd_m_s", "velocity", "m/s", "d down", _V),
    _ned("vu", "vu_m_s", "velocity", "m/s", "u up", _V),
)
_SD = "sd? std? sigma? stddev? sdpos? stdpos? ?sd ?std ?sigma sig? possd? posstd? "
_SDV = "sdv? stdv? sigmav? sdvel? stdvel? sigmavel? velsd? velstd? v?sd v?std v?sigma sigv? stddevv? "
_SDS = (
    _ned("sd_n", "sd_n_m", "length", "m", "n north lat latitude", _SD),
    _ned("sd_e", "sd_e_m", "length", "m", "e east lon longitude", _SD),
    _ned("sd_d", "sd_d_m", "length", "m", "d down u up height alt h hgt", _SD),
    _ned("sd_vn", "sd_vn_m_s", "velocity", "m/s", "n north", _SDV),
    _ned("sd_ve", "sd_ve_m_s", "velocity", "m/s", "e east", _SDV),
    _ned("sd_vd", "sd_vd_m_s", "velocity", "m/s", "d down u up", _SDV),
)
# What receivers of phones and of ROS give instead of standard deviations and of velocities north, east, down; see
# `insnav.input.interpret.derived`.
_RECEIVER = (
    _one("speed", "speed_m_s", "velocity", "m/s", "speed groundspeed gspeed sog speedoverground velocity gndspeed"),
    _one("course", "course_deg", "angle", "deg", "course bearing cog track courseoverground headmot direction"),
    _one("radius", "accuracy_m", "length", "m", "horizontalaccuracy hacc accuracy haccuracy accuracyhorizontal"),
    _one("accuracy_d", "accuracy_d_m", "length", "m", "verticalaccuracy vacc vaccuracy accuracyvertical"),
    _one("accuracy_speed", "accuracy_speed_m_s", "velocity", "m/s", "speedaccuracy sacc velocityaccuracy speedacc"),
    _one("accuracy_course", "accuracy_course_deg", "angle", "deg", "bearingaccuracy courseaccuracy headacc"),
    _one("var_e", "var_e", "", "", "positioncovariance0 covariance0"),
    _one("var_n", "var_n", "", "", "positioncovariance4 covariance4"),
    _one("var_d", "var_d", "", "", "positioncovariance8 covariance8"),
    _one("status", "status", "", "", "statusstatus navsatstatus"),
    _one(
        "lat_sign", "lat_sign", "", "", "ns northsouth latns latdir latdirection latitudedirection nsindicator latref"
    ),
    _one("lon_sign", "lon_sign", "", "", "ew eastwest lonew londir londirection longitudedirection ewindicator lonref"),
)
_HEADING = _one(
    "heading", "heading_deg", "angle", "deg", "heading yaw hdg psi trueheading azimuth yawangle headingtrue"
)
_FIX = _one("fix", "fix", "", "", "fix fixtype fixquality quality q gpsfix posmode solutiontype")

IMU_SCHEMA: tuple[Quantity, ...] = (
    _TIME_COLUMN,
    *TIME_PARTS,
    *_axes("gyro", "rate", "rad/s", "rad_s", _GYRO, ("p rollrate", "q pitchrate", "r yawrate")),
    *_axes("accel", "acceleration", "m/s^2", "m_s2", _ACCEL),
    # A gyro column in units of angle holds increments, whatever its name; so for an accelerometer column.
    *_axes("dtheta", "angle", "rad", "rad", f"{_DTHETA} {_GYRO}"),
    *_axes("dvel", "velocity", "m/s", "m_s", f"{_DVEL} {_ACCEL}"),
    _one("temperature", "temperature_c", "temperature", "degC", "temperature temp imutemp imutemperature"),
    _one("odometer", "odometer_m_s", "velocity", "m/s", _FORWARD_SPEED),
    _one("baro", "baro_height_m", "length", "m", "baro baroheight baroaltitude baroalt barometer pressureheight"),
)
GPS_SCHEMA: tuple[Quantity, ...] = (
    _TIME_COLUMN,
    *TIME_PARTS,
    *_POSITION,
    *_VELOCITY,
    *_SDS,
    *_RECEIVER,
    _HEADING,
    _FIX,
)
REFERENCE_SCHEMA: tuple[Quantity, ...] = (
    _TIME_COLUMN,
    *TIME_PARTS,
    *_POSITION,
    *_VELOCITY,
    *_SDS,
    _one("roll", "roll_deg", "angle", "deg", "roll rollangle phi"),
    _one("pitch", "pitch_deg", "angle", "deg", "pitch pitchangle theta"),
    _HEADING,
    _FIX,
)

# Logs of further sensors: what each may hold, and the alternatives of columns of which it must hold one.
LOG_SCHEMAS: dict[str, tuple[tuple[Quantity, ...], tuple[tuple[str, ...], ...]]] = {
    "speedometer": (
        (
            _TIME_COLUMN,
            _one("speed", "speed_m_s", "velocity", "m/s", f"speed velocity v groundspeed {_FORWARD_SPEED}"),
            _one("sd", "sd_m_s", "velocity", "m/s", "sd std sigma sdspeed speedsd stdspeed"),
        ),
        (("speed",),),
    ),
    "magnetometer": (
        (_TIME_COLUMN, _HEADING, *_axes("mag", "", "", "", "mag? magnetometer? magneticfield? m? b? ?mag")),
        (("mag_x", "mag_y", "mag_z"), ("heading",)),
    ),
}

# Words that loggers put before a name; taken off when the whole is not known.
PREFIXES = _spread("imu field gps gnss msg data ins raw sensor ref nav pos twist location motion", "")

_MORE_UNITS: dict[str, tuple[str, float]] = {
    "us": ("time", 1e-6),
    "ns": ("time", 1e-9),
    "mdeg/s": ("rate", 1e-3 * DEG),
    "mrad/s": ("rate", 1e-3),
    "r/min": ("rate", 6.0 * DEG),
    "urad": ("angle", 1e-6),
    "cm/s^2": ("acceleration", 1e-2),
    "mm/s^2": ("acceleration", 1e-3),
    "ft/s^2": ("acceleration", 0.3048),
    "mm/s": ("velocity", 1e-3),
    "knot": ("velocity", 1852.0 / 3600.0),
    "mph": ("velocity", 0.44704),
    "ft/s": ("velocity", 0.3048),
    "g*s": ("velocity", G0),
    "ft": ("length", 0.3048),
    "degC": ("temperature", 1.0),
}
ALL_UNITS: dict[str, tuple[str, float]] = {**UNITS, **_MORE_UNITS}

_UNIT_SPELLINGS = {
    "s": "sec secs second seconds",
    "ms": "msec msecs millis millisecond milliseconds",
    "us": "usec usecs micros microsecond microseconds",
    "ns": "nsec nsecs nanos nanosecond nanoseconds",
    "rad": "radian radians radsample radpersample",
    "deg": "degree degrees degsample degpersample",
    "mrad": "milliradian milliradians",
    "rad/s": "radsec rads1 radpers radpersec radps radianss radianssec radianspersecond radpersecond",
    "deg/s": "dps degsec degs1 degpers degpersec degps degreess degreessec degreespersecond degpersecond",
    "deg/h": "dph degph degperh deghr degperhr degperhour degreeshour degreesh",
    "mdeg/s": "mdps",
    "mrad/s": "mradps mradsec mradpersec",
    "r/min": "rpm revmin",
    "m/s^2": "mps2 mss msec2 mpers2 mperssq mssq ms2 mpss ms2sample meters2 mpersec2 meterpersecondsquared",
    "g": "gs gee",
    "mg": "millig",
    "ug": "microg",
    "m/s": "mps msec ms1 mpers mpersec msample meterss meterpersecond",
    "mm/s": "mmps mmsec",
    "cm/s": "cmps cmsec",
    "km/h": "kph kmph kmhr",
    "knot": "knots kn kt kts",
    "m": "meter meters metre metres",
    "mm": "millimeter millimeters millimetre millimetres",
    "degC": "c celsius degcelsius",
    "V": "volt volts",
    "mV": "millivolt millivolts",
    "uV": "microvolt microvolts",
    "LSB": "count counts digit digits adc",
}


def _unit_table() -> dict[str, dict[str, str]]:
    table: dict[str, dict[str, str]] = {}
    for unit, (dimension, _) in ALL_UNITS.items():
        words = [compact(unit), *_UNIT_SPELLINGS.get(unit, "").split()]
        for word in words:
            table.setdefault(dimension, {})[word] = unit
    return table


# dimension -> compact spelling -> unit
UNIT_SPELLINGS: dict[str, dict[str, str]] = _unit_table()
