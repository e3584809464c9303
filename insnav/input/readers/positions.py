"""Reader of positions and velocities: fixes of a receiver, and references."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from insnav.earth import ned_offset
from insnav.exceptions import InputError
from insnav.findings import Code, Finding
from insnav.input.formats import delimited_text, kf_gins, matlab, parquet, sensor_folder
from insnav.input.formats.registry import open_table
from insnav.input.formats.table import Table
from insnav.input.interpret.clean import GPS_KINDS, REFERENCE_KINDS, Kinds
from insnav.input.interpret.columns import Found, agrees, position_columns, quote_columns, require, suggest, understand
from insnav.input.interpret.composed import derive, undulation
from insnav.input.interpret.physics import stated_unit
from insnav.input.interpret.schema import ALL_UNITS, GPS_SCHEMA, IMU_SCHEMA, REFERENCE_SCHEMA, Quantity, compact
from insnav.input.interpret.velocities import Fit, fit_velocities, turns_in_radians
from insnav.input.readers.reading import Reading
from insnav.input.readers.rows import SLOWEST, read_rows
from insnav.types import BoolArray, FloatArray, GpsData, Trajectory
from insnav.units import DEG

Height = Literal["ellipsoidal", "msl"]

_MAX_HEIGHT = 1e5  # limits of plausible heights [m]
_MIN_HEIGHT = -1e4
_FAR = 0.1 * DEG  # a fix at (0, 0) is a placeholder if all other fixes are farther away [rad]
_MOVES, _CLIMBS = 100.0, 5.0  # horizontal, vertical motion of a reference [m]: with more, a column of zeros is unknown
_ROOM = {"px", "prsrx", "posx", "positionx"}  # headers of local positions, as in EuRoC and TUM-VI
# formats that define no height datum; the empty name means data in memory
_ANY_HEIGHT = {"", *(module.name for module in (delimited_text, kf_gins, matlab, parquet, sensor_folder))}
# columns that identify ArduPilot, PX4, GoPro (GPMF: MSLV); their documents define ``Alt`` above mean sea level
_OF_SEA_LEVEL = {"timeus", "epv", "altitudesystem"}
_ATTITUDE = ("roll", "pitch", "heading")
_STANDARD_DEVIATIONS = ("sd_n", "sd_e", "sd_d", "sd_vn", "sd_ve", "sd_vd")


@dataclass(frozen=True, slots=True)
class Positions:
    """Positions, velocities and other columns of a file, in order of time."""

    columns: dict[str, FloatArray]  # (n,) by key, in SI units and radians
    # (n, 3) latitude [rad], longitude [rad], height [m]; velocity North, East, Down [m/s], NaN where not known
    lla: FloatArray
    v_n: FloatArray

    def stacked(self, keys: Sequence[str]) -> FloatArray:
        """Stack columns to ``(n, len(keys))``; a missing column is NaN."""
        unknown = np.full(len(self.lla), np.nan)
        return np.column_stack([self.columns.get(key, unknown) for key in keys])


def read_gps(
    path: str | Path | Table, *, columns: Mapping[str, str] | None = None, height: Height | None = None
) -> Reading[GpsData]:
    """Read GPS fixes.

    Parameters
    ----------
    path : str or Path
        A data file of any supported format, or ``-`` for standard input.
    columns : mapping of str to str, optional
        Quantity, with or without unit, to header: ``{"sd_n_m": "sigma"}``; an empty header omits the quantity.
    height : {"ellipsoidal", "msl"}, optional
        Type of the heights; by default from the header, else ellipsoidal, with a finding.

    Returns
    -------
    Reading of GpsData

    Raises
    ------
    InputError
        The file cannot be used.
    ConfigError
        A named column does not exist.
    """
    reading = read_positions(path, "GPS", GPS_SCHEMA, GPS_KINDS, columns=columns, height=height)
    read = reading.data
    heading = read.columns.get("heading")
    heading = None if heading is None or not heading.any() else heading % (2.0 * np.pi)  # only zeros: unknown
    sd = (read.stacked(_STANDARD_DEVIATIONS[:3]), read.stacked(_STANDARD_DEVIATIONS[3:]))
    seen = (each if each is not None and each.any() else None for each in map(read.columns.get, ("satellites", "dop")))
    data = GpsData(read.columns["time"], read.lla, read.v_n, *sd, reading.fix, heading, *seen)
    return Reading(data, reading.events, reading.facts)


def read_reference(path: str | Path | Table, *, columns: Mapping[str, str] | None = None) -> Reading[Trajectory]:
    """Read a reference: position, and velocity and attitude if present; see `read_gps`.

    Returns: a reading; its `fix` contains the file's fix types, if any. Raises: InputError: the file cannot be used.
    """
    reading = read_positions(path, "reference", REFERENCE_SCHEMA, REFERENCE_KINDS, columns=columns)
    read = reading.data
    rph = read.stacked(_ATTITUDE)
    rph[:, 2] %= 2.0 * np.pi
    zeros = _zeros_in_motion(read.lla, read.v_n, rph)
    if zeros:
        note = Finding.of(Code.READ_COLUMNS_ZERO_IN_MOTION, subject="ref", columns=tuple(zeros))
        reading = replace(reading, facts=replace(reading.facts, evidence=(*reading.facts.evidence, note)))
    sd = read.stacked(_STANDARD_DEVIATIONS)
    sd_or_none = np.hstack([sd, np.full_like(rph, np.nan)]) if np.isfinite(sd).any() else None
    data = Trajectory(read.columns["time"], read.lla, read.v_n, rph, sd_or_none)
    return Reading(data, reading.events, reading.facts, reading.fix)


def _zeros_in_motion(lla: FloatArray, v_n: FloatArray, rph: FloatArray) -> list[str]:
    """Set columns that are zero throughout a moving reference to NaN, in place; return their names."""
    moved = np.ptp(ned_offset(lla, lla[0]), axis=0) if len(lla) else np.zeros(3)
    climbs, turns = float(moved[2]) > _CLIMBS, bool((moved[:2] > _MOVES).all())  # on a drive north, heading is zero
    unknown: list[str] = []
    for names, values, moves in (
        (("vn", "ve", "vd"), v_n, bool((moved[:2] > _MOVES).any())),
        (("vd",), v_n[:, 2:], climbs),
        (("heading",), rph[:, 2:], turns),
        (("roll", "pitch"), rph[:, :2], turns and climbs),
    ):
        if moves and not values.any():
            values[:] = np.nan
            unknown += names
    return unknown


def read_positions(
    path: str | Path | Table,
    kind: str,
    schema: Sequence[Quantity],
    kinds: Kinds,
    *,
    columns: Mapping[str, str] | None,
    height: Height | None = None,
) -> Reading[Positions]:
    """Read a file of fixes or of a reference: positions, velocities and attitude, in SI units; see `read_gps`."""
    table = open_table(path, "gps" if kind == "GPS" else "reference")
    name = table.name
    found, notes = understand(table.headers, table.units, schema, columns=columns, parts=table.parts, where=name)
    height_key, height_kind, height_evidence = _height(found, height, table, "--gps-height" if kind == "GPS" else "")
    hint, gives = "", dict[str, Any]()
    if sum(header.lower().startswith(("gyro", "acc", "dtheta", "dvel")) for header in table.headers) > 3:
        hint = "imu_as_positions"
    elif not {"time", "lat"} <= found.keys() and agrees(by_values := position_columns(table), found, IMU_SCHEMA):
        gives = {"columns": {key: header for key, header in by_values.items() if key not in found}} if by_values else {}
    if "lat" not in found and _ROOM & {re.sub(r"\[.*|[\W_]", "", header.lower()) for header in table.headers}:
        raise InputError("input.local_positions", where=name, headers=tuple(filter(None, table.headers[:8])))
    indices_used = {column.index for column in found.values()}
    unused = [header for i, header in enumerate(table.headers) if header and i not in indices_used]
    height_quantity = next(quantity for quantity in schema if quantity.key == height_key)
    no_height = kind == "GPS" and height_key not in found and suggest(height_quantity, unused) is None
    wanted = ("time", "lat", "lon", *(() if no_height else (height_key,)))
    require(found, wanted, table, schema, hint=hint, gives=gives)
    keys = [key for key in found if key not in ("height", "height_msl") or key == height_key]
    rows = read_rows(table, found, keys, kinds, slowest=SLOWEST)
    raw = rows.columns
    for key in keys[:]:
        if key != "time" and found[key].factor != 1.0:
            raw[key] = raw[key] * found[key].factor
    no_height = no_height or (kind == "GPS" and not np.isfinite(raw[height_key]).any())
    if no_height:
        raw.pop(height_key, None)
        height_evidence = Finding.of(Code.READ_HEIGHT_MISSING)
    raw["height"] = np.zeros_like(raw["lat"]) if no_height else raw.pop(height_key)
    notes = (*notes, *derive(raw, found))
    bad = ~np.isfinite(raw["time"]) | _no_position(raw)
    notes = (*notes, *_raise_rounded(raw, bad, found))
    _refuse_impossible(raw, bad, found, table, height_key)
    cleaned = rows.clean(bad, Code.ROWS_NO_POSITION)
    data = cleaned.columns
    lla = np.column_stack([data["lat"], (data["lon"] + np.pi) % (2.0 * np.pi) - np.pi, data["height"]])
    if "vd" not in data and "vu" in data:
        data["vd"] = -data["vu"]
    unknown = np.full(len(lla), np.nan)
    v_n = np.column_stack([data.get(key, unknown) for key in ("vn", "ve", "vd")])
    fit = fit_velocities(data["time"], lla, v_n)
    angle_factor, unit_note = _angles(lla, fit, found, name)
    lla[:, :2] *= angle_factor
    if height_kind == "msl" and not no_height and (geoid := undulation(lla[:, 0], lla[:, 1])) is not None:
        lla[:, 2] += geoid[0]
        added: dict[str, Any] = {"grid": geoid[1], "height_m": float(np.mean(geoid[0]))}
        height_kind, height_evidence = "ellipsoidal", Finding.of(Code.READ_HEIGHT_GEOID_ADDED, **added)
    unit, velocity_notes = _velocity_unit(fit, found, name)
    if (fit is not None and fit.in_vehicle) or not np.isfinite(v_n[:, :2]).any():  # vertical velocity alone is unused
        v_n[:] = np.nan
        data |= {key: np.full(len(lla), np.nan) for key in _STANDARD_DEVIATIONS[3:] if key in data}
    if unit != 1.0:
        measured = 2 + bool({"vd", "vu"} & found.keys())  # a vertical speed derived from heights is in m/s already
        v_n[:, :measured] *= unit
        for key in ("sd_vn", "sd_ve", "sd_vd")[:measured]:
            if key in data:
                data[key] = data[key] * unit
    filled = {key: column for key, column in found.items() if key not in data or np.isfinite(data[key]).any()}
    unstated = [key for key in _ATTITUDE if key in filled and not filled[key].unit]
    attitude = [data[key] for key in unstated]
    in_radians = "heading" in unstated and turns_in_radians(data["time"], lla, v_n, np.column_stack(attitude))
    if in_radians:
        data |= {key: data[key] / DEG for key in unstated}
    evidence = (height_evidence, unit_note, *velocity_notes, *_attitude_findings(filled, unstated, in_radians), *notes)
    units = {"time": rows.time_unit, **dict.fromkeys(unstated if in_radians else (), "rad")}
    columns_read = {found[key].quantity.name: found[key].describe(units.get(key)) for key in keys}
    if "fix" in data and not data["fix"].any() and np.ptp(lla[:, :2], axis=0).any():
        del data["fix"]
        evidence = (*evidence, Finding.of(Code.READ_COLUMNS_FIX_ZERO, subject=found["fix"].header))
    fix = np.where(np.isfinite(data["fix"]), data["fix"], -1.0).astype(np.int64) if "fix" in data else None
    reading = rows.reading(kind, Positions(data, lla, v_n), cleaned, columns_read, evidence, height=height_kind)
    return replace(reading, fix=fix)


def _height(found: Mapping[str, Found], height: Height | None, table: Table, option: str) -> tuple[str, str, Finding]:
    """Return key and type of the height column, with evidence. `option`: command-line option for the type, if any."""
    words = {compact(header) for header in table.headers}
    height_header = compact(found["height"].header) if "height" in found else ""
    msl_by_program = "alt" in height_header and "ellipsoid" not in height_header and bool(words & _OF_SEA_LEVEL)
    msl_column = "height_msl" in found and (height == "msl" or "height" not in found)
    key = "height_msl" if msl_column else "height"
    kind = "msl" if msl_column or height == "msl" or (msl_by_program and not height) else "ellipsoidal"
    option_used = option if height else ""
    column = "" if height or not found.keys() & {key} else found[key].header
    if kind == "msl":
        return key, kind, Finding.of(Code.READ_HEIGHT_MSL, column=column, option=option_used)
    named = column if "ellip" in compact(column) else ""
    if height or named or table.format not in _ANY_HEIGHT:
        by_format = "" if height or named else table.format
        return key, kind, Finding.of(Code.READ_HEIGHT_ELLIPSOIDAL, format=by_format, column=named, option=option_used)
    return key, kind, Finding.of(Code.READ_HEIGHT_ELLIPSOIDAL_ASSUMED, change=option)


def _no_position(raw: dict[str, FloatArray]) -> BoolArray:
    """Find rows without a position: empty cells, and the placeholder (0, 0) of a receiver without a fix."""
    lat, lon = raw["lat"], raw["lon"]
    bad: BoolArray = ~(np.isfinite(lat) & np.isfinite(lon) & np.isfinite(raw["height"]))
    if "status" in raw:
        bad |= raw.pop("status") < 0.0  # a negative status in ROS means no fix
    origin = ~bad & (lat == 0.0) & (lon == 0.0)
    if not origin.any():
        return bad
    others = ~bad & ~origin
    nearest = float(np.min(np.abs(lat[others]) + np.abs(lon[others]), initial=np.inf))
    # a receiver never measures exactly (0, 0) twice: repetitions are placeholders, even without other fixes
    placeholder = nearest > _FAR and bool(others.any() or np.count_nonzero(origin) > 1)
    no_fix = raw["fix"] == 0.0 if "fix" in raw else np.zeros_like(bad)
    bad |= origin & (no_fix | placeholder)
    return bad


def _raise_rounded(raw: dict[str, FloatArray], bad: BoolArray, found: Mapping[str, Found]) -> list[Finding]:
    """Replace standard deviations that are rounded to zero by the smallest nonzero value of their column."""
    notes = []
    for key in _STANDARD_DEVIATIONS:
        if key not in raw or key not in found:  # derived standard deviations are above zero
            continue
        zero, positive = ~bad & (raw[key] == 0.0), ~bad & (raw[key] > 0.0)
        if zero.any() and positive.any():
            least = float(raw[key][positive].min())
            raw[key] = np.where(zero, least, raw[key])
            header, count = found[key].header, int(np.count_nonzero(zero))
            if found[key].quantity.dimension == "length":
                notes.append(Finding.of(Code.READ_SD_RAISED, subject=header, count=count, sd_m=least))
            else:
                notes.append(Finding.of(Code.READ_SD_RAISED, subject=header, count=count, sd_m_s=least))
    return notes


def _refuse_impossible(
    raw: Mapping[str, FloatArray], bad: BoolArray, found: Mapping[str, Found], table: Table, height_key: str
) -> None:
    """Refuse a file with impossible positions, velocities or standard deviations; the error names the first one."""
    limits = {
        "lat": (-90.0 * DEG, 90.0 * DEG, "latitude"),
        "lon": (-180.0 * DEG, 360.0 * DEG, "longitude"),
        "height": (_MIN_HEIGHT, _MAX_HEIGHT, "height"),
    }
    for key, (low, high, quantity) in limits.items():
        slack = 1e-12 * max(abs(low), high)
        wrong = ~bad & ((raw[key] < low - slack) | (raw[key] > high + slack))
        if wrong.any():
            row = int(np.flatnonzero(wrong)[0])
            column = found[height_key if key == "height" else key]
            lat, lon = (float(np.max(np.abs(raw[angle][~bad]))) / DEG for angle in ("lat", "lon"))
            if key == "lat" and wrong[~bad].mean() > 0.5 and lat <= 180.0 and lon <= 90.0:
                where = table.place(row, column.index)
                raise _exchanged("input.exchanged_by_value", found, where, lat_rad=float(raw[key][row]))
            values: dict[str, Any] = {"column": column.header, "count": int(np.count_nonzero(wrong))}
            suffix = "m" if key == "height" else "rad"
            sizes = {"value": float(raw[key][row]), "low": low, "high": high}
            values |= {f"{name}_{suffix}": size for name, size in sizes.items()}
            values |= {} if key == "height" else {"quantity": quantity}
            raise InputError(
                "input.impossible_height" if key == "height" else "input.impossible_angle",
                where=table.place(row, column.index),
                **values,
            )
    for key in ("vn", "ve", "vd", "vu", *_STANDARD_DEVIATIONS):
        if key not in raw or key not in found:
            continue
        sd = key in _STANDARD_DEVIATIONS
        if (wrong := ~bad & (raw[key] <= 0.0 if sd else np.isinf(raw[key]))).any():
            row = int(np.flatnonzero(wrong)[0])
            values = {"column": found[key].header, "count": int(np.count_nonzero(wrong))}
            where = table.place(row, found[key].index)
            zero = [name for name in _STANDARD_DEVIATIONS if name in raw and name in found and not raw[name].any()]
            if key in zero:
                left_out = dict.fromkeys(zero, "")
                values |= {"option": "--columns", "columns": quote_columns(left_out)}
                raise InputError("input.zero_sd", where=where, gives={"columns": left_out}, **values)
            if sd:
                raise InputError("input.bad_sd", where=where, value=float(raw[key][row]), **values)
            raise InputError("input.infinite_velocity", where=where, **values)


def _angles(lla: FloatArray, fit: Fit | None, found: Mapping[str, Found], name: str) -> tuple[float, Finding]:
    """Return the factor to correct latitudes and longitudes that were read as degrees, and the evidence.

    Raises: InputError: the file does not determine degrees or radians, or its header states the wrong unit.
    """
    stated = found["lat"].unit
    if fit is not None and fit.radians in ("latitudes", "longitudes"):
        wrong_key, right_key = ("lat", "lon") if fit.radians == "latitudes" else ("lon", "lat")
        column, other = found[wrong_key].header, found[right_key].header
        raise InputError("input.column_in_radians", where=name, quantity=fit.radians, column=column, other=other)
    in_deg = np.abs(lla[:, :2]) / DEG
    large = (in_deg[:, 0] > 0.5 * np.pi).any() or (in_deg[:, 1] > np.pi).any()
    if stated not in (None, "deg") or (stated and large):
        return 1.0, stated_unit("positions", str(stated))
    if large:
        return 1.0, Finding.of(Code.READ_ANGLES_LARGE, unit="deg")
    if fit is not None and fit.radians:
        if stated:
            raise InputError("input.positions_in_radians", where=name)
        return 1.0 / DEG, Finding.of(Code.READ_ANGLES_BY_VELOCITY, unit="rad")
    if stated:
        return 1.0, stated_unit("positions", stated)
    if fit is not None:
        return 1.0, Finding.of(Code.READ_ANGLES_BY_VELOCITY, unit="deg")
    raise InputError("input.angle_unit_unclear", where=name)


def _velocity_unit(fit: Fit | None, found: Mapping[str, Found], name: str) -> tuple[float, list[Finding]]:
    """Return the factor that converts the velocities in the file to m/s, and the evidence.

    Raises: InputError: the position changes contradict the names or units of the velocity columns.
    """
    if fit is None or fit.radians:
        return 1.0, []
    if fit.exchanged:
        raise _exchanged("input.exchanged_by_velocity", found, name)
    columns = [found[key] for key in ("vn", "ve", "vd", "vu", "speed") if key in found]
    if fit.in_vehicle:
        return 1.0, [Finding.of(Code.READ_VELOCITY_IN_VEHICLE, columns=tuple(column.header for column in columns))]
    if not fit.as_named:
        directions = [("vn", "ve")[i] for i in fit.order] if "vn" in found else []
        right = {key: found[other].header for key, other in zip(("vn", "ve"), directions, strict=False)}
        named: dict[str, Any] = {"option": "--columns", "columns": quote_columns(right) if right else ""}
        if -1.0 not in fit.signs:
            raise InputError("input.velocities_exchanged", where=name, gives={"columns": right}, **named)
        if fit.order == (0, 1):
            raise InputError("input.velocities_mirrored", where=name, **_mirrored(fit, found))
        raise InputError("input.velocities_mirrored_exchanged", where=name, **_mirrored(fit, found), **named)
    if fit.upward and "vd" in found:
        header = found["vd"].header
        named = {"option": "--columns", "columns": quote_columns({"vu": header})}
        raise InputError("input.velocity_up", where=name, gives={"columns": {"vu": header}}, column=header, **named)
    if fit.unit == "m/s":
        return 1.0, []
    if any(column.unit for column in columns):
        stated = next(column for column in columns if column.unit)
        values: dict[str, Any] = {
            "stated": stated.unit,
            "ratio": fit.ratio,
            "unit": fit.unit,
            "example": stated.quantity.key,
        }
        raise InputError("input.velocity_unit", where=name, **values)
    return ALL_UNITS[fit.unit][1], [Finding.of(Code.READ_VELOCITY_UNIT, ratio=fit.ratio, unit=fit.unit)]


def _mirrored(fit: Fit, found: Mapping[str, Found]) -> dict[str, Any]:
    """Return the headers of velocity columns with the wrong sign, and of the positions that contradict them."""
    wrong = [pair for pair, sign in zip((("vn", "lat"), ("ve", "lon")), fit.signs, strict=True) if sign < 0.0]
    headers = [tuple(found[key].header if key in found else key for key in keys) for keys in zip(*wrong, strict=True)]
    return dict(zip(("velocities", "positions"), headers, strict=True))


def _exchanged(code: str, found: Mapping[str, Found], where: str, **values: Any) -> InputError:
    """Build the error for exchanged latitudes and longitudes."""
    right = {"lat": found["lon"].header, "lon": found["lat"].header}
    columns, gives = quote_columns(right), {"columns": right}
    return InputError(code, where=where, gives=gives, option="--columns", columns=columns, **values)


def _attitude_findings(found: Mapping[str, Found], unstated: Sequence[str], in_radians: bool) -> list[Finding]:
    """Report the interpretation of attitude columns. `unstated`: attitude columns without unit."""
    notes = []
    if "heading" in found and "yaw" in found["heading"].header.lower():
        notes.append(Finding.of(Code.READ_ANGLES_YAW, subject=found["heading"].header))
    if unstated:
        code = Code.READ_ANGLES_ATTITUDE_BY_COURSE if in_radians else Code.READ_ANGLES_ATTITUDE_ASSUMED
        columns = tuple(found[key].header for key in unstated)
        notes.append(Finding.of(code, columns=columns, unit="rad" if in_radians else "deg"))
    return notes
