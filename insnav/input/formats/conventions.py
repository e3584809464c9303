"""Common functions of formats: axes by gravity, columns by name, library errors on damaged files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insnav.earth import level_from_earth
from insnav.exceptions import InputError, InsnavError
from insnav.findings import Code, Finding
from insnav.input.formats.messages import at_times
from insnav.input.formats.source import Source
from insnav.input.formats.table import Numbers, Table, column_table
from insnav.plain_text import plain_text
from insnav.types import FloatArray
from insnav.units import DEG

GYRO = ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s")
ACCEL = ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2")
DTHETA = ("dtheta_x_rad", "dtheta_y_rad", "dtheta_z_rad")
DVEL = ("dvel_x_m_s", "dvel_y_m_s", "dvel_z_m_s")
PLACE, MSL_PLACE = (("lat_deg", "lon_deg", height) for height in ("height_m", "height_msl_m"))
VELOCITY = ("vn_m_s", "ve_m_s", "vd_m_s")
ATTITUDE = ("roll_deg", "pitch_deg", "heading_deg")
# codes of flight controllers and phones (2D, 3D, DGPS, RTK float, RTK fixed) -> fix type
FIX_TYPES = {2: 5.0, 3: 5.0, 4: 4.0, 5: 2.0, 6: 1.0}
_LONGEST_SD = 1e4  # a larger standard deviation marks an unknown accuracy [m], [m/s]


def up_or_down(accel_z: FloatArray, up: str, down: str = "FRD") -> str:
    """Return the axes `up` of a format, or `down` if specific force along z ``(n,)`` shows that z points down."""
    known = accel_z[np.isfinite(accel_z)]
    return down if len(known) and float(np.median(known)) < -4.9 else up


def number_in(text: str | bytes) -> float:
    """Parse a text as number; ``NaN`` if invalid."""
    try:
        return float(text)
    except ValueError:
        return float("nan")


def triad(names: tuple[str, ...], values: FloatArray) -> dict[str, FloatArray]:
    """Split an array ``(n, 3)`` into three columns."""
    return dict(zip(names, np.ascontiguousarray(values.T), strict=True))


def deviations(sd: FloatArray, names: str) -> dict[str, FloatArray]:
    """Split standard deviations North, East, Down ``(n, 3)`` into columns (``sd_{}_m``); invalid values are NaN."""
    with np.errstate(invalid="ignore"):
        known = np.where((sd > 0.0) & (sd < _LONGEST_SD), sd, np.nan)
    return {names.format(axis): known[:, i] for i, axis in enumerate("ned")}


def by_accuracy(horizontal: FloatArray, vertical: FloatArray, speed: FloatArray | None = None) -> dict[str, FloatArray]:
    """Convert accuracies ``(n,)`` to standard deviations along axes: horizontal and speed accuracies over sqrt(2)."""
    axis_sd = horizontal / np.sqrt(2.0)
    columns = deviations(np.column_stack([axis_sd, axis_sd, vertical]), "sd_{}_m")
    return columns if speed is None else columns | deviations(np.column_stack([speed / np.sqrt(2.0)] * 3), "sd_v{}_m_s")


def of_course(speed: FloatArray, course: FloatArray, down: FloatArray) -> dict[str, FloatArray]:
    """Compute velocity columns from speed [m/s], course [deg] and velocity down [m/s], ``(n,)``."""
    angle = course * DEG
    return triad(VELOCITY, np.column_stack([speed * np.cos(angle), speed * np.sin(angle), down]))


def with_force(columns: dict[str, FloatArray], time: FloatArray, force: FloatArray) -> dict[str, FloatArray]:
    """Interpolate accelerations ``(m, 3)`` from times ``(m,)`` to gyro columns; rows outside are dropped."""
    base_time = columns["time_s"]
    merged = columns | {key: at_times(base_time, time, force[:, i]) for i, key in enumerate(ACCEL)}
    inside = (base_time >= np.nanmin(time)) & (base_time <= np.nanmax(time))
    return {key: np.ascontiguousarray(column[inside]) for key, column in merged.items()}


def fix_table(
    source: Source,
    columns: Mapping[str, FloatArray],
    kind: NDArray[Any],
    types: Mapping[int, float],
    notes: Iterable[Finding | None],
    *,
    row: str,
    cut: Finding | None = None,
    week: float | None = None,
) -> Table:
    """Build a table of fixes without invalid rows.

    `kind` (n,): code of the fix in the format, NaN for invalid rows. `types`: fix type by valid code.
    """
    fix = np.array([types.get(int(code), 0.0) if code == code else 0.0 for code in kind], dtype=np.float64)
    kept = fix > 0.0
    valid = {key: np.asarray(column[kept], dtype=np.float64) for key, column in {**columns, "fix": fix}.items()}
    return column_table(source, valid, [*notes, without_fix(kept)], row=row, cut=cut, week=week)


def without_fix(kept: NDArray[np.bool_]) -> Finding | None:
    """Report epochs that are dropped because they have no fix; `kept` ``(n,)`` marks the other epochs."""
    lost = int(np.count_nonzero(~kept))
    return Finding.of(Code.READ_ROWS_NO_FIX, count=lost, rows=len(kept)) if lost else None


@contextmanager
def damaged(code: str, source: Source, **values: Any) -> Iterator[None]:
    """Convert any error that a library raises on a damaged file to an `InputError`."""
    try:
        yield
    except (InsnavError, ImportError):
        raise
    except Exception as error:
        reason = plain_text(f"{type(error).__name__}: {error}")[:200].rstrip(".")
        raise InputError(code, where=source.name, reason=reason, **values) from error


@dataclass(frozen=True, slots=True)
class TextColumns:
    """Columns of a text file, read together so that all end at the same row."""

    columns: Mapping[str, FloatArray]  # (n,) by header in lower-case letters
    headers: tuple[str, ...]  # all headers of the file
    cut: Finding | None  # reason for dropping the last row, if dropped

    def named(self, wanted: Mapping[str, str]) -> dict[str, FloatArray]:
        """Return columns under new names (`wanted`: name to header), ignoring case; missing columns are omitted."""
        return {key: self.columns[h.lower()] for key, h in wanted.items() if h.lower() in self.columns}


def text_columns(table: Table, headers: Iterable[str]) -> TextColumns:
    """Read the requested numeric columns, as far as a table contains them."""
    present = {header.strip().lower(): index for index, header in enumerate(table.headers)}
    indices = {header.lower(): present[header.lower()] for header in headers if header.lower() in present}
    numbers = table.cells.read(sorted(set(indices.values()))) if indices else Numbers({}, 0)
    columns = {header: numbers.columns[index] for header, index in indices.items()}
    return TextColumns(columns, table.headers, numbers.cut)


def level_covariance(covariance: FloatArray, lla: FloatArray) -> FloatArray:
    """Convert Earth-fixed covariances ``(n, 3, 3)`` to sd North, East, Down; a negative variance becomes zero.

    `lla` (n, 3): latitude, longitude [rad], height [m].
    """
    to_level = level_from_earth(lla)
    variance: FloatArray = np.einsum("nij,njk,nik->ni", to_level, covariance, to_level)
    return np.sqrt(np.maximum(variance, 0.0))
