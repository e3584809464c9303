"""Alternative representations of fixes, converted to latitude, velocity N/E/D and standard deviations.

References
----------
Android `Location.getAccuracy`: the radius of 68 % confidence; so is the horizontal accuracy of Core Location. For two
equal normal components that radius is ``sqrt(-2 ln 0.32)`` standard deviations of one. NMEA 0183: ``ddmm.mmmm``.
ROS `sensor_msgs/NavSatFix`: covariance in m^2, east, north, up, row by row; status below 0 is no fix. PROJ: vgridshift.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress

import numpy as np

from insnav.findings import Code, Finding
from insnav.input.interpret.columns import Found, unused_columns
from insnav.types import FloatArray
from insnav.units import DEG

RADIUS = math.sqrt(-2.0 * math.log(0.32))  # of 68 % confidence, in standard deviations of one component
_MOST = 0.9  # share of rows that cannot be degrees
_STILL = 0.3  # below this speed a receiver gives no course [m/s]
_CLIMB_SD = 2.0  # least sd of a vertical speed derived from heights [m/s]


def derive(raw: dict[str, FloatArray], found: Mapping[str, Found]) -> list[Finding]:
    """Derive quantities in the columns ``(n,)`` [SI, rad], in place; return findings."""
    notes = _integers(raw, found)
    notes += _degrees_minutes(raw, found)
    notes += _signs(raw, found)
    notes += _velocities(raw, found)
    notes += _deviations(raw, found)
    return notes


def _integers(raw: dict[str, FloatArray], found: Mapping[str, Found]) -> list[Finding]:
    """Convert u-blox and PX4 integers: degrees times 1e7, with millimetres."""
    written = {key: raw[key][np.isfinite(raw[key])] / found[key].factor for key in ("lat", "lon")}
    whole = (len(values) and (np.abs(values - np.round(values)) < 1e-3).all() for values in written.values())
    if found["lat"].unit or not all(whole):
        return []
    size = {key: float(np.abs(values).max()) for key, values in written.items()}
    if not (max(size.values()) > 18_000.0 * 100.0 and size["lat"] <= 90e7 and size["lon"] <= 180e7):
        return []
    for key in ("lat", "lon"):
        raw[key] = raw[key] * 1e-7
    height = raw["height"][np.isfinite(raw["height"])]
    column = found["height"] if "height" in found else found["height_msl"]
    if column.unit or not len(height) or (height != np.round(height)).any():
        return [Finding.of(Code.POSITIONS_INTEGER)]
    raw["height"] = raw["height"] * 1e-3
    return [Finding.of(Code.POSITIONS_INTEGER), Finding.of(Code.POSITIONS_INTEGER_HEIGHTS)]


def _degrees_minutes(raw: dict[str, FloatArray], found: Mapping[str, Found]) -> list[Finding]:
    """Convert degrees and minutes in one number, as in NMEA: 4807.038 is 48 deg 7.038 min."""
    written = {key: raw[key] / found[key].factor for key in ("lat", "lon")}
    known = {key: values[np.isfinite(values)] for key, values in written.items()}
    if found["lat"].unit not in (None, "deg") or not all(len(values) for values in known.values()):
        return []
    whole = {key: np.abs(values) // 100.0 for key, values in known.items()}
    minutes = all(bool((np.abs(values) % 100.0 < 60.0).all()) for values in known.values())
    far = max(float(np.mean(np.abs(known["lat"]) > 90.0)), float(np.mean(np.abs(known["lon"]) > 360.0))) > _MOST
    swapped = max(np.abs(known["lat"]).max() / 180.0, np.abs(known["lon"]).max() / 90.0) <= 1.0  # far more likely
    if not (far and minutes and whole["lat"].max() < 90.0 and whole["lon"].max() <= 180.0) or swapped:
        return []
    for key, values in written.items():
        size = np.abs(values)
        raw[key] = np.sign(values) * (size // 100.0 + (size % 100.0) / 60.0) * DEG
    return [Finding.of(Code.POSITIONS_DEGREES_MINUTES, angle_rad=raw["lat"][0], written=known["lat"][0])]


def _signs(raw: dict[str, FloatArray], found: Mapping[str, Found]) -> list[Finding]:
    """Apply south and west from columns of letters."""
    notes: list[Finding] = []
    for key in ("lat", "lon"):
        sign = raw.pop(f"{key}_sign", None)
        if sign is not None:
            raw[key] = np.where(np.isfinite(sign), sign, np.nan) * np.abs(raw[key])
            letters = found[f"{key}_sign"].header
            notes.append(Finding.of(Code.POSITIONS_SIGN, column=found[key].header, letters=letters))
    return notes


def _velocities(raw: dict[str, FloatArray], found: Mapping[str, Found]) -> list[Finding]:
    """Convert speed and course to velocity north and east, and heights to vertical speed."""
    speed, course = raw.pop("speed", None), raw.pop("course", None)
    speed_sd, course_sd = raw.pop("accuracy_speed", None), raw.pop("accuracy_course", None)
    if "vn" in raw or "ve" in raw or speed is None or course is None:
        unused = [found[key].header for key, column in (("speed", speed), ("course", course)) if column is not None]
        return [unused_columns(unused)] if unused and "vn" not in raw else []
    speed = np.where(speed >= 0.0, speed, np.nan)  # -1 means unknown
    known = np.isfinite(speed) & (np.isfinite(course) & (course >= 0.0) | (speed < _STILL))
    course = np.where(np.isfinite(course), course, 0.0)
    raw["vn"] = np.where(known, speed * np.cos(course), np.nan)
    raw["ve"] = np.where(known, speed * np.sin(course), np.nan)
    columns = found["speed"].header, found["course"].header
    notes: list[Finding] = [Finding.of(Code.VELOCITY_FROM_COURSE, speed=columns[0], course=columns[1])]
    if speed_sd is not None and (speed_sd > 0.0).any():
        sd = np.where(speed_sd > 0.0, speed_sd, np.nan)
        if course_sd is not None:
            across = speed * np.where(course_sd > 0.0, course_sd, 0.0)
            sd = np.fmax(sd, np.where(np.isfinite(across), across, 0.0))
        raw["sd_vn"], raw["sd_ve"] = sd, sd.copy()
        notes.append(Finding.of(Code.VELOCITY_SD_COLUMN, column=found["accuracy_speed"].header))
    if "vd" not in raw and "vu" not in raw:
        climb, climb_sd = _climb(raw)
        raw["vd"] = np.where(known, -climb, np.nan)
        if "sd_vn" in raw:
            raw["sd_vd"] = np.where(np.isfinite(raw["sd_vn"]), np.maximum(raw["sd_vn"], climb_sd), np.nan)
        notes.append(Finding.of(Code.VELOCITY_FROM_HEIGHTS, sd_m_s=climb_sd))
    return notes


def _climb(raw: Mapping[str, FloatArray]) -> tuple[FloatArray, float]:
    """Compute the height rate between neighbouring fixes [m/s], with its sd by its scatter."""
    time, height = raw["time"], raw["height"]
    rate = np.zeros(len(time))
    if len(time) > 2:
        step = time[2:] - time[:-2]
        inner = np.where(step > 0.0, (height[2:] - height[:-2]) / np.where(step > 0.0, step, 1.0), 0.0)
        rate[1:-1] = np.where(np.isfinite(inner), inner, 0.0)
    return rate, max(_CLIMB_SD, 1.4826 * float(np.median(np.abs(rate))))


def _deviations(raw: dict[str, FloatArray], found: Mapping[str, Found]) -> list[Finding]:
    """Convert variances and confidence radii to standard deviations."""
    notes: list[Finding] = []
    radius, vertical = raw.pop("radius", None), raw.pop("accuracy_d", None)
    variances = {axis: raw.pop(f"var_{axis}", None) for axis in "ned"}
    if "sd_n" in raw:
        return notes
    if all(column is not None and (column > 0.0).any() for column in variances.values()):
        for axis, column in variances.items():
            assert column is not None
            raw[f"sd_{axis}"] = np.sqrt(np.where(column > 0.0, column, np.nan))
        columns = tuple(found[f"var_{axis}"].header for axis in "ned")
        notes.append(Finding.of(Code.SD_FROM_VARIANCES, columns=columns))
    elif radius is not None and (radius > 0.0).any():
        raw["sd_n"] = np.where(radius > 0.0, radius, np.nan) / RADIUS
        raw["sd_e"] = raw["sd_n"].copy()
        notes.append(Finding.of(Code.SD_FROM_RADIUS, column=found["radius"].header))
        if vertical is not None and (vertical > 0.0).any():
            raw["sd_d"] = np.where(vertical > 0.0, vertical, 2.0 * raw["sd_n"])
            notes.append(Finding.of(Code.SD_VERTICAL_COLUMN, column=found["accuracy_d"].header))
        else:
            raw["sd_d"] = 2.0 * raw["sd_n"]
            notes.append(Finding.of(Code.SD_VERTICAL_TWICE))
    return notes


def undulation(lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, str] | None:
    """Return heights of the geoid above the ellipsoid [m], and the grid of PROJ; None without pyproj or a grid.

    `lat`, `lon` (n,): [rad].
    """
    with suppress(ImportError):
        from pyproj import Transformer
        from pyproj.exceptions import ProjError

        for grid in ("us_nga_egm08_25.tif", "us_nga_egm96_15.tif"):
            with suppress(ProjError):
                shift = Transformer.from_pipeline(f"+proj=vgridshift +grids={grid} +multiplier=1")
                height = np.asarray(shift.transform(lon, lat, np.zeros(len(lat)), radians=True)[2], dtype=np.float64)
                return (height, grid) if np.isfinite(height).all() else None
    return None
