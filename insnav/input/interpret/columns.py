"""Identification of columns: each header is matched with a quantity and its unit; errors suggest similar headers."""

from __future__ import annotations

import difflib
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, Finding
from insnav.input.formats.table import Table
from insnav.input.interpret.schema import ALL_UNITS, PREFIXES, UNIT_SPELLINGS, Quantity, compact
from insnav.input.interpret.velocities import fit_velocities
from insnav.types import FloatArray
from insnav.units import DEG

_BRACKETS = re.compile(r"^(?P<base>[^\[\](){}]+?)\s*[\[({](?P<unit>[^\[\](){}]*)[\])}]\s*$")
_WORDS = re.compile(r"[^\W_]+")
_INDEXED = re.compile(r"^(?P<base>.+?)\[(?P<index>\d)\]$")  # header with an index, such as gyro[0]
_QUATERNION = re.compile(r"q(uat(ernion)?)?[ _.]?[wxyz0-3]", re.IGNORECASE)
_COUNTED = re.compile(r"^(?P<base>.*?[A-Za-z_ ]\[?)(?P<index>[0-3])(?P<rest>(?:[\s_\[\](].*)?)$")
_MEANT = {  # compact header -> header with the unit that it really has
    "verticalaccuracydeg": "vertical accuracy (m)",  # phyphox gives degrees instead of metres
    "millis": "time (ms)",
    "timestartup": "time (ns)",  # header in VectorNav files, which count nanoseconds
    "micros": "time (us)",
    **dict.fromkeys(("utcnano", "logmonotime"), "time (ns)"),
}
_NO_UNIT = re.compile("wgs84|txt|x[0-9a-f]{4}")  # texts in brackets that are no unit, such as a message number
# before the name in a header: topic path (PlotJuggler), device with serial number (SensorConnect) or colon (DatCon)
_DEVICE = re.compile(r"^(?:/[^/]+(?=/.)|/|.*(?:\d{4,}[._:/ -]+|:)(?=[A-Za-z]))")
_CHIP = re.compile(r"(?i).+\b(accelerometer|gyroscope)(?: (?!uncal)[^.]*)?[.]([xyz])")  # Android: chip, sensor, axis
_NAMED = 3  # least number of quantities, besides time, in a header line
_LISTED = 12  # largest number of unused columns that a finding lists


@dataclass(frozen=True, slots=True)
class Found:
    """Identified column."""

    quantity: Quantity  # its quantity
    index: int  # column index in the file, from 0
    header: str  # its header as written
    unit: str | None  # unit stated by file or user, or ``None``

    @property
    def factor(self) -> float:
        """Factor from the stated unit to SI; without a stated unit, from the unit of the canonical name."""
        unit = self.unit or self.quantity.unit
        return ALL_UNITS[unit][1] if unit else 1.0

    def describe(self, unit: str | None = None) -> str:
        """Return the header with its unit in brackets."""
        unit = unit or self.unit or self.quantity.unit
        return f"{self.header} [{unit}]" if unit else self.header


def find_unit(text: str, dimension: str) -> str | None:
    """Return the unit that a text spells, if it has the dimension (see `insnav.units.UNITS`); otherwise None."""
    if text in ALL_UNITS:  # exact names first: "ms" is not "m/s"
        return text if ALL_UNITS[text][0] == dimension else None
    table = UNIT_SPELLINGS.get(dimension, {})
    word = compact(text)
    return table.get(word) or table.get(word.removesuffix("sample").removesuffix("per"))


def match_header(
    header: str, schema: Sequence[Quantity], unit_below: str = ""
) -> tuple[Quantity, str | None, int] | None:
    """Match one header with a quantity.

    `header`: such as ``gyro_x[deg/s]``, ``gx_dps``, ``Latitude (deg)``. `unit_below`: unit from the row of units.
    Returns: the quantity, the stated unit, and a rank (0: the most reliable spelling); None without a match. A known
    name with an unknown unit in brackets is refused.
    """
    if compact(header) in _MEANT:
        header = _MEANT[compact(header)]
    if (indexed := _INDEXED.match(header)) is not None:
        header = indexed["base"] + indexed["index"]
    bracket = _BRACKETS.match(header)
    base, unit_text = (bracket["base"], bracket["unit"]) if bracket else (header, unit_below)
    unit_text = unit_text.strip(" []()-_")
    if _NO_UNIT.fullmatch(compact(unit_text)):
        unit_text = ""
    word = compact(base)
    for attempt in range(4):
        known = _match_word(word, unit_text, schema)
        if known is not None:
            quantity, unit, rank = known
            return quantity, unit, rank + 1000 * attempt
        prefix = next((p for p in PREFIXES if word.startswith(p) and len(word) > len(p)), None)
        if prefix is None:
            break
        word = word.removeprefix(prefix)
    if (chip := _CHIP.fullmatch(base.strip())) is not None:
        return match_header(f"{chip[1]} {chip[2]} [{unit_text}]", schema, unit_below)
    return match_header(header[device.end() :], schema, unit_below) if (device := _DEVICE.match(header)) else None


def key_of(header: str, schema: Sequence[Quantity]) -> str:
    """Return the key of the quantity that a header names; empty if the header or its unit is unknown."""
    with suppress(InputError):
        match = match_header(header, schema)
        return match[0].key if match else ""
    return ""


def is_header(line: str, schema: Sequence[Quantity]) -> bool:
    """Return True if a line names the time and at least three other quantities of a schema."""
    keys = {key_of(header, schema) for header in re.split("[,;\t]", line.replace('"', ""))} - {""}
    return "time" in keys and len(keys) > _NAMED


def _match_word(word: str, unit_text: str, schema: Sequence[Quantity]) -> tuple[Quantity, str | None, int] | None:
    refused: Quantity | None = None
    for quantity in schema:
        if word == compact(quantity.name):
            return quantity, quantity.unit or None, -1
        if word in quantity.spellings:
            rank = quantity.spellings.index(word)
            if not unit_text or not quantity.dimension:
                return quantity, None, rank
            if (unit := find_unit(unit_text, quantity.dimension)) is not None:
                return quantity, unit, rank
            refused = refused or quantity
    if refused is not None:
        values: dict[str, Any] = {
            "quantity": refused.key,
            "dimension": refused.dimension,
            "units": tuple(unit for unit, (kind, _) in ALL_UNITS.items() if kind == refused.dimension),
        }
        raise InputError("columns.unknown_unit", text=unit_text, **values)
    for cut in range(len(word) - 1, 0, -1):
        for quantity in schema:
            for base in (word[:cut], word[:cut].removesuffix("in")):  # a header such as ``time in ms``
                unit = UNIT_SPELLINGS.get(quantity.dimension, {}).get(word[cut:])
                if base in quantity.spellings and unit is not None:
                    return quantity, unit, quantity.spellings.index(base)
    return None


def understand(
    headers: Sequence[str],
    units_row: Sequence[str] | None,
    schema: Sequence[Quantity],
    *,
    columns: Mapping[str, str] | None = None,
    parts: Mapping[str, int] | None = None,
    where: str = "",
) -> tuple[dict[str, Found], tuple[Finding, ...]]:
    """Assign columns to quantities.

    `units_row`: row of units under the header, if any. `columns`: the user's columns: quantity, with or without unit
    (``gyro_x``, ``gyro_x_dps``), to header; an empty header means that the file lacks the quantity. `parts`: index of
    columns, by header, that were composed to other columns; the user may name them.
    Raises: InputError: a duplicate header, or two columns for one quantity. ConfigError: `columns` names a missing
    column, or contradicts the unit of its header.
    """
    named = [h for h in headers if h]
    repeated = sorted({h for h in named if named.count(h) > 1})
    if repeated:
        raise InputError("columns.header_twice", where=where, column=repeated[0], count=named.count(repeated[0]))
    by_user, absent = _given(headers, units_row, schema, columns or {}, parts or {}, where)
    taken = {found.index for found in by_user.values()}
    ranked: dict[str, list[tuple[int, Found]]] = {}
    unused: list[str] = []
    notes: list[Finding] = []
    for index, (header, renamed) in enumerate(zip(headers, from_zero(headers), strict=True)):
        if not header or index in taken:
            continue
        match = None
        with suppress(InputError):  # unknown unit: `require` reports it if the column is needed
            match = match_header(renamed, schema, units_row[index] if units_row else "")
        if match is not None and match[0].key not in by_user and match[0].key not in absent:
            ranked.setdefault(match[0].key, []).append((match[2], Found(match[0], index, header, match[1])))
        elif match is None:
            unused.append(header)
    found = dict(by_user)
    # the column with the most reliable spelling is used; equally reliable columns are ambiguous
    for key, candidates in ranked.items():
        candidates.sort(key=lambda item: (item[0], item[1].index))
        best = candidates[0]
        if len(candidates) > 1 and candidates[1][0] == best[0]:
            both = tuple(c.header for rank, c in candidates if rank == best[0])
            given_as: dict[str, Any] = {"option": "--columns", "columns": quote_columns({key: best[1].header})}
            raise InputError("columns.ambiguous", where=where, quantity=key, headers=both, **given_as)
        found[key] = best[1]
        for _, duplicate in candidates[1:]:
            notes.append(Finding.of(Code.COLUMNS_TWICE, column=duplicate.header, quantity=key, used=best[1].header))
    quats = [header for header in unused if _QUATERNION.fullmatch(header.strip())]
    if len(quats) == 4 and "heading" in {q.key for q in schema} and not {"roll", "pitch", "heading"} & found.keys():
        notes.append(Finding.of(Code.COLUMNS_QUATERNION, columns=tuple(quats)))
    if unused and not is_headerless(headers):
        notes.append(unused_columns(unused))
    return found, tuple(notes)


def unused_columns(headers: Sequence[str]) -> Finding:
    """Report columns that are not read."""
    more: dict[str, Any] = {"more": len(headers) - _LISTED} if len(headers) > _LISTED else {}
    return Finding.of(Code.COLUMNS_UNUSED, count=len(headers), columns=tuple(headers[:_LISTED]), **more)


def from_zero(headers: Sequence[str]) -> list[str]:
    """Renumber headers of arrays that count from 1 to 3, to count from 0 to 2 as in the schema."""
    parts = [_COUNTED.match(header) for header in headers]
    counts: dict[tuple[str, str], set[str]] = {}
    for part in parts:
        if part is not None:
            counts.setdefault((part["base"], part["rest"]), set()).add(part["index"])
    spelled = list(headers)
    for i, part in enumerate(parts):
        if part is not None and counts[part["base"], part["rest"]] == {"1", "2", "3"}:
            spelled[i] = f"{part['base']}{int(part['index']) - 1}{part['rest']}"
    return spelled


def _given(
    headers: Sequence[str],
    units_row: Sequence[str] | None,
    schema: Sequence[Quantity],
    columns: Mapping[str, str],
    parts: Mapping[str, int],
    where: str,
) -> tuple[dict[str, Found], set[str]]:
    """Return the columns that the user named, by key, and the keys that the user declared absent."""
    given: dict[str, Found] = {}
    absent: set[str] = set()
    for name, header in columns.items():
        match = match_header(name, schema)
        if match is None:
            keys = [q.key for q in schema]
            known: dict[str, Any] = {"close": close} if (close := _closest(name, keys)) else {"known": tuple(keys)}
            raise ConfigError("columns.unknown_quantity", where="columns", quantity=name, **known)
        quantity, unit, _ = match
        if not header:
            absent.add(quantity.key)
            continue
        if header not in headers and header not in parts:
            values: dict[str, Any] = {
                "column": header,
                "file": where,
                "close": _closest(header, headers),
                **_listed(headers),
            }
            raise ConfigError("columns.no_such_column", where=f"columns, {name}", **values)
        index = parts[header] if header in parts else list(headers).index(header)
        header_unit = _unit_in(header, units_row[index] if units_row else "", quantity.dimension)
        if unit and header_unit not in (None, unit):
            values = {"column": header, "unit": header_unit, "given": unit, "quantity": quantity.key}
            raise ConfigError("columns.unit_conflict", where=f"columns, {name}", **values)
        given[quantity.key] = Found(quantity, index, header, unit or header_unit)
    return given, absent


def _unit_in(header: str, unit_below: str, dimension: str) -> str | None:
    """Find the unit of a column in brackets in its header, in the row of units, or in the last words of the header."""
    bracket = _BRACKETS.match(header)
    words = _WORDS.findall(header)
    for text in (bracket["unit"] if bracket else "", unit_below, *("_".join(words[i:]) for i in range(1, len(words)))):
        if text and (unit := find_unit(text.strip(" []()-_"), dimension)) is not None:
            return unit
    return None


def require(
    found: Mapping[str, Found],
    keys: Iterable[str],
    table: Table,
    schema: Sequence[Quantity],
    *,
    hint: str = "",
    gives: Mapping[str, Any] | None = None,
) -> None:
    """Refuse a file without a required column; the error lists its columns and suggests similar ones.

    `hint`: message key for the apparent content of the file. `gives`: columns identified by their values.
    """
    keys = tuple(keys)
    missing = [q for key in keys if key not in found for q in schema if q.key == key]
    if not missing:
        return
    headers, where = table.headers, table.name
    # if a needed column has an unknown unit, this is the error
    for named, unit in zip(headers, table.units or [""] * len(headers), strict=False):
        try:
            match_header(named, missing, unit)
        except InputError as error:
            error.where = f"{where}: column {named!r}"
            raise
    if len(headers) == 1 and not hint:
        raise InputError("format.one_column", where=where, header=headers[0][:80])
    by_values = quote_columns(gives["columns"]) if gives else ""
    if is_headerless(headers):
        numbers = "" if by_values else quote_columns(dict.fromkeys(keys, "NUMBER"))
        values: dict[str, Any] = {
            "hint": hint,
            "guess": "" if hint else by_values,
            "numbers": numbers,
            "option": "--columns",
        }
        raise InputError("columns.no_header", where=where, gives=gives, count=len(headers), **values)
    used = {f.index for f in found.values()}
    unused = [h for i, h in enumerate(headers) if h and i not in used]
    candidates = [h for h in unused if not key_of(h, schema)]
    listed: dict[str, Any] = {"quantities": tuple(q.name for q in missing), **_listed(headers)}
    split_time = {"hour", "minute"} <= {compact(header).removesuffix("s") for header in unused}
    if split_time and "time" in {q.key for q in missing}:
        raise InputError("columns.time_in_parts", where=where, **listed)
    similar = {}  # header with a similar name, by key
    for quantity in missing:
        if (header := suggest(quantity, candidates)) is not None:
            candidates.remove(header)
            similar[quantity.key] = header
    by_name = len(similar) == len(missing) if by_values else bool(similar) and not hint  # names are better evidence
    advice: dict[str, Any] = (
        {"meant": quote_columns(similar)} if by_name else {"hint": hint} if hint else {"guess": by_values}
    )
    advice |= {"option": "--columns", "example": "" if any(advice.values()) else missing[0].key}
    gives = {"columns": similar} if by_name else gives
    raise InputError("columns.missing", where=where, gives=gives, **listed, **advice)


def agrees(columns: Mapping[str, str], found: Mapping[str, Found], schema: Sequence[Quantity]) -> bool:
    """Return True if columns identified by values contradict no names, in `found` or in another `schema`."""
    named = {column.header: key for key, column in found.items()}
    unnamed = [header for key, header in columns.items() if key != "time" and header not in named]
    other_kind = any(key_of(header, schema) for header in unnamed)
    return not other_kind and all(named.get(header, key) == key for key, header in columns.items())


def quote_columns(columns: Mapping[str, str]) -> str:
    """Build the value of the option ``--columns``, quoted for a shell."""
    return shlex.quote(",".join(f"{key}={header}" for key, header in columns.items()))


def suggest(quantity: Quantity, headers: Sequence[str]) -> str | None:
    """Find the header most similar to a quantity's spellings, or None."""
    best: tuple[float, str] | None = None
    names = (compact(quantity.name), compact(quantity.key), *(s for s in quantity.spellings if len(s) > 2))
    for header in headers:
        word = compact(_BRACKETS.sub(r"\g<base>", header))
        score = max(difflib.SequenceMatcher(None, word, s).ratio() for s in names)
        if score >= 0.7 and (best is None or score > best[0]):
            best = (score, header)
    return best[1] if best else None


def _closest(word: str, choices: Iterable[str]) -> str:
    """Return the most similar of the choices; empty if none is similar."""
    return next(iter(difflib.get_close_matches(word, list(choices), n=1, cutoff=0.6)), "")


def _listed(words: Sequence[str], limit: int = 40) -> dict[str, Any]:
    """Return the first words of a list, and the number of omitted words, as values of an error."""
    return {"known": tuple(word or "—" for word in words[:limit]), "more": max(0, len(words) - limit) or None}


_ROWS = 50_000  # number of rows that are examined to identify columns by their values
_GRAVITIES = (9.8, 1.0, 1000.0)  # gravity in m/s^2, g and mg
_TOLERANCE = 0.05  # relative tolerance of gravity
_LAT, _LON, _HEIGHT, _SPAN = 90.0, 360.0, 1e5, 20.0  # largest values [deg], [m], and span of positions [deg]


def is_headerless(headers: Sequence[str]) -> bool:
    """Return True if the headers are only the numbers 1, 2, 3, as for a table without header."""
    return tuple(headers) == tuple(str(i + 1) for i in range(len(headers)))


def imu_columns(table: Table) -> dict[str, str]:
    """Identify the columns of time, gyros and accelerometers by their values; empty if ambiguous.

    Time increases with every row. Three adjacent columns have the norm of gravity; the only other three are the gyros.
    """
    columns = _columns(table)
    times = [i for i, values in enumerate(columns) if _advances(values)]
    if len(times) != 1:
        return {}
    rest = [i for i in range(len(columns)) if i != times[0]]
    triads = [rest[k : k + 3] for k in range(len(rest) - 2) if rest[k + 2] - rest[k] == 2]
    heavy = [triad for triad in triads if _shows_gravity([columns[i] for i in triad])]
    if len(heavy) != 1:
        return {}
    gyro_triads = [triad for triad in triads if not set(triad) & set(heavy[0])]
    if len(gyro_triads) != 1:
        return {}
    indices = {"time": times[0]}
    indices |= {f"gyro_{axis}": i for axis, i in zip("xyz", gyro_triads[0], strict=True)}
    indices |= {f"accel_{axis}": i for axis, i in zip("xyz", heavy[0], strict=True)}
    return {key: table.headers[i] for key, i in indices.items()}


def position_columns(table: Table) -> dict[str, str]:
    """Identify the columns of time, and of latitude, longitude and height in this order, by their values.

    Adds the first two adjacent columns that are velocities North and East according to the position changes.
    """
    columns = _columns(table)
    times = [i for i, values in enumerate(columns) if _advances(values)]
    for first in range(times[0] + 1, len(columns) - 2) if times else ():
        lat, lon, height = columns[first : first + 3]
        plausible = all(
            np.nanmax(np.abs(values), initial=0.0) <= limit
            for values, limit in ((lat, _LAT), (lon, _LON), (height, _HEIGHT))
        )
        if plausible and max(np.ptp(lat), np.ptp(lon)) < _SPAN and not (lat == np.round(lat)).all():
            indices = dict(zip(("time", "lat", "lon", "height"), (times[0], first, first + 1, first + 2), strict=True))
            lla = np.column_stack([lat * DEG, lon * DEG, height])
            for k in range(first + 3, len(columns) - 2):
                fit = fit_velocities(columns[times[0]], lla, np.column_stack(columns[k : k + 3]))
                if fit is not None and fit.as_named and not fit.misplaced:
                    indices |= {"vn": k, "ve": k + 1}
                    break
            return {key: table.headers[i] for key, i in indices.items()}
    return {}


def _columns(table: Table) -> list[FloatArray]:
    try:
        numbers = table.cells.read(range(len(table.headers)))
    except InputError:  # a column contains text, not numbers
        return []
    return [numbers.columns[i][:_ROWS] for i in range(len(table.headers))]


def _advances(values: FloatArray) -> bool:
    step = np.diff(values[np.isfinite(values)])
    return len(step) > 2 and bool(np.mean(step > 0.0) > 0.98) and bool(np.ptp(step) < 1e3 * abs(np.median(step)))


def _shows_gravity(triad: Sequence[FloatArray]) -> bool:
    norm = np.linalg.norm(np.column_stack(triad), axis=1)
    known = norm[np.isfinite(norm)]
    middle = float(np.median(known)) if known.size else 0.0
    return any(abs(middle / gravity - 1.0) < _TOLERANCE for gravity in _GRAVITIES)
