"""Library of real IMUs: every figure with its source document, and an error specification by one rule.

A part is one file of ``parts/``. Undocumented figures are missing, not guessed. Conversion to one standard deviation:

- a tolerance (+-) or a maximum of a bias, a scale factor or an angle is two standard deviations, "3 sd" is three.
Typical, RMS and 1 sd values count unchanged, and so does every noise density, including limits;
- the lowest point of an Allan deviation is 0.664 times the flicker noise, so the in-run bias is this point over 0.664
(IEEE Std 952-1997, annex C). It is measured at constant temperature, so a documented standard deviation of the in-run
bias (of a filter, or of a paper) has priority;
- turn-on and in-run bias are separate; an undocumented correlation time is an hour;
- of several documents the most direct one counts: datasheet, Allan deviation, paper, filter tuning, second hand. Of
equal documents the largest figure counts.
"""

from __future__ import annotations

import difflib
import functools
import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import PlainValidator

from insnav.config_file import Table, axes, read_toml, scalar, validate
from insnav.exceptions import ConfigError
from insnav.imu.specification import SENSORS, TERMS, ImuSpec, SensorSpec, terms_of
from insnav.types import FloatArray

FOLDER = Path(__file__).parent / "parts"
PROVENANCE = ("datasheet", "Allan", "paper", "filter tuning", "second hand")  # kinds of documents, most direct first
Statistic = Literal["density", "1 sd", "typical", "tolerance", "maximum", "3 sd", "Allan minimum"]
TO_SD: dict[str, float] = {"tolerance": 0.5, "maximum": 0.5, "3 sd": 1.0 / 3.0, "Allan minimum": 1.0 / 0.664}
HOUR = 3600.0  # default correlation time [s]
_DIMENSIONS = {f"{term.sensor}.{term.key}": term.dimension for term in TERMS}
_DIMENSIONS |= {f"{name}.correlation_time": "time" for name in SENSORS}


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of an IMU, as a document states it."""

    key: str  # key of the IMU file, such as ``gyro.bias``
    text: tuple[str, ...]  # value as written, for all axes or one per axis
    value: FloatArray  # (3,) this value in SI
    statistic: str  # one of `Statistic`
    stated: str  # wording of the document, or derivation from its content
    # title and location of the document, and its kind, one of `PROVENANCE`
    document: str
    where: str
    provenance: str
    used: bool  # True if `Part.spec` uses this figure of its key

    @property
    def sd(self) -> FloatArray:
        """`value` as one standard deviation or density, ``(3,)`` in SI."""
        return self.value * TO_SD.get(self.statistic, 1.0)


@dataclass(frozen=True, slots=True)
class Part:
    """Real IMU with its documented figures."""

    name: str
    maker: str
    grade: str  # accuracy grade, such as ``consumer``; see `insnav.imu.specification`
    temperature: str  # specified operating range; empty if unknown
    note: str  # doubtful or omitted figures
    figures: tuple[Figure, ...]
    spec: ImuSpec  # from the figures with `used`

    @property
    def provenance(self) -> str:
        """Kind of the least direct document of the figures that `spec` uses."""
        return max((figure.provenance for figure in self.figures if figure.used), key=PROVENANCE.index)

    @property
    def missing(self) -> tuple[str, ...]:
        """Keys of usual figures that no document states, such as ``gyro.bias``."""
        return tuple(key for key in self.spec.absent if not key.endswith("correlation_time"))


def completed(part: Part, of: ImuSpec) -> tuple[ImuSpec, tuple[str, ...]]:
    """Fill missing figures of a part with figures of its class; a filter would take missing figures as zero.

    `of`: specification of the class. Returns: the completed specification, and the keys taken from the class.
    """
    sensors = {}
    for name in SENSORS:
        of_part, of_class = getattr(part.spec, name), getattr(of, name)
        keys = [key.partition(".")[2] for key in part.spec.absent if key.startswith(f"{name}.")]
        if "bias_instability" not in keys:  # the correlation time stays with its in-run bias
            keys = [key for key in keys if key != "correlation_time"]
        sensors[name] = replace(of_part, **{key: getattr(of_class, key) for key in keys})
    return replace(part.spec, **sensors), part.missing


class _Document(Table):
    title: str
    where: str
    provenance: Literal["datasheet", "Allan", "paper", "filter tuning", "second hand"]


class _Figure(Table):
    key: str
    value: str | list[str]
    statistic: Statistic
    document: str
    stated: str = ""


class _File(Table):
    name: str
    maker: str
    grade: Literal["consumer", "automotive", "industrial", "tactical", "navigation"]
    temperature: str = ""
    note: str = ""
    documents: dict[str, _Document]
    figures: list[_Figure]


def _plain(name: str) -> str:
    """Reduce a name to letters and digits: ``ADIS16505-3`` and ``adis 16505 3`` are equal."""
    return re.sub(r"[^a-z0-9]", "", name.casefold())


@functools.cache
def _files() -> dict[str, Path]:
    """Return the file of every part, by its plain name."""
    return {_plain(path.stem): path for path in sorted(FOLDER.glob("*.toml"))}


def find_part(name: str) -> Part | None:
    """Find a part by name, in any case and with or without hyphens; None if unknown."""
    path = _files().get(_plain(name))
    return None if path is None else read_part(path)


def parts() -> tuple[Part, ...]:
    """Return all parts, in the order of their names."""
    return tuple(read_part(path) for path in _files().values())


def close_names(name: str) -> tuple[str, ...]:
    """Find part names similar to an unknown name."""
    plain = _plain(name)
    close = [key for key in _files() if plain and plain in key] or difflib.get_close_matches(plain, _files(), n=3)
    return tuple(_files()[key].stem for key in close)


@functools.cache
def read_part(path: Path) -> Part:
    """Read the file of a part. Raises: ConfigError: invalid file, or a figure with unknown key, unit or document."""
    file = validate(_File, read_toml(path), str(path))
    for figure in file.figures:
        if figure.key not in _DIMENSIONS or figure.document not in file.documents:
            raise ConfigError("imu.unknown_figure", where=str(path), key=figure.key, document=figure.document)
    chosen = _chosen(file)
    converted = []
    for row in file.figures:
        document, used = file.documents[row.document], row is chosen[row.key]
        text = (row.value,) if isinstance(row.value, str) else tuple(row.value)
        origin = document.title, document.where, document.provenance
        converted.append(Figure(row.key, text, _si(row, path), row.statistic, row.stated, *origin, used))
    figures = tuple(converted)
    return Part(file.name, file.maker, file.grade, file.temperature, file.note, figures, _spec(file, figures))


def _chosen(file: _File) -> dict[str, _Figure]:
    """Choose a figure for every key: no Allan minimum if possible, then the most direct document, the largest value."""

    def standing(figure: _Figure) -> tuple[bool, int, float]:
        rank = PROVENANCE.index(file.documents[figure.document].provenance)
        return figure.statistic == "Allan minimum", rank, -float(np.max(_si(figure, Path(file.name))))

    return {key: min((f for f in file.figures if f.key == key), key=standing) for key in {f.key for f in file.figures}}


def _si(figure: _Figure, path: Path) -> FloatArray:
    """Convert the value of a figure to SI, ``(3,)``."""
    dimension = _DIMENSIONS[figure.key]
    kind: PlainValidator = scalar(dimension) if dimension == "time" else axes(dimension)

    class Value(Table):
        value: Annotated[object, kind]

    return np.broadcast_to(np.array(validate(Value, {"value": figure.value}, f"{path}: {figure.key}").value), 3)


def _spec(file: _File, figures: tuple[Figure, ...]) -> ImuSpec:
    """Build the error specification from the figures with `used`."""
    sd_by_key = {figure.key: figure.sd for figure in figures if figure.used}
    sensors, absent = {}, []
    for name in SENSORS:
        given = {key.partition(".")[2]: value for key, value in sd_by_key.items() if key.startswith(f"{name}.")}
        usual = [*(term.key for term in terms_of(name) if term.usual), "correlation_time"]
        absent += [f"{name}.{key}" for key in usual if key not in given]
        tau = float(given.pop("correlation_time", np.full(3, HOUR))[0])
        tau = tau if "bias_instability" in given else math.inf
        sensors[name] = SensorSpec(correlation_time=tau, **given)
    documents = "; ".join(f"{document.title} ({document.where})" for document in file.documents.values())
    return ImuSpec(
        file.name, sensors["gyro"], sensors["accel"], source=f"{documents}. {file.note}".strip(), absent=tuple(absent)
    )
