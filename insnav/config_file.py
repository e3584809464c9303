"""Configuration files in TOML: presets by name, quantities with unit, all errors reported together."""

from __future__ import annotations

import copy
import difflib
import functools
import math
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, NoReturn, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, PlainValidator, ValidationError, create_model, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from insnav.exceptions import ConfigError, reason_of
from insnav.units import UNITS, plain_unit, units_of

_QUANTITY = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)\s*$")


def parse_quantity(text: str, dimension: str, *, where: str = "") -> float:
    """Convert a text with a unit to a number in SI and radians.

    `text`: such as ``"0.1 deg/h"``; the unit is required. `dimension`: required dimension: ``"rate"``,
    ``"acceleration"``, ``"angle random walk"``, …. `where`: location named in the error.
    Raises: ConfigError: no unit, an unknown unit, a unit of another dimension, or a number that is not finite.

    Examples
    --------
    >>> from insnav.units import DEG
    >>> round(parse_quantity("3600 deg/h", "rate") / DEG, 12)
    1.0
    """
    units = tuple(units_of(dimension))
    match = _QUANTITY.match(text) if isinstance(text, str) else None
    if match is None:
        raise ConfigError("unit.missing", where=where, text=str(text), unit=units[0])
    number, unit = float(match[1]), plain_unit(match[2])
    if unit not in UNITS:
        raise ConfigError("unit.unknown", where=where, text=text, unit=unit, units=units)
    dim, factor = UNITS[unit]
    if dim != dimension:
        raise ConfigError(
            "unit.of_other_dimension", where=where, text=text, unit=unit, other=dim, dimension=dimension, units=units
        )
    if not math.isfinite(number * factor):
        raise ConfigError("unit.not_finite", where=where, text=text)
    return number * factor


MAX_BYTES = 1_000_000  # longest accepted file; an IMU file has one or two kB
MAX_TEXT = 100  # longest plausible text of a number and its unit [characters]
# error types of pydantic: the type that it expected, and the comparison with a limit that failed
_KINDS = {
    **{"bool_type": "true or false", "dict_type": "a table", "list_type": "a list"},
    **dict.fromkeys(("float_type", "float_parsing"), "a number"),
    **dict.fromkeys(("int_type", "int_from_float"), "a whole number"),
}
_RELATIONS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤", "min_length": "≥", "max_length": "≤"}
# `_NO_KEY` matches strings, comments. `_LONG_KEY` matches a dotted key of more than twenty parts. The memory of tomllib
# for a key grows with the square of the number of its parts.
_NO_KEY = re.compile(r'''"""(?:\\.|[^\\])*?"""|\'{3}.*?\'{3}|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*''', re.DOTALL)
_LONG_KEY = re.compile(r"(?:\.[ \t]*[\w-]+[ \t]*){20}")

Axes = tuple[float, float, float]
Matrix = tuple[Axes, Axes, Axes]
Model = TypeVar("Model", bound="Table")


class Table(BaseModel):
    """TOML table in which an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", strict=True)
    either: ClassVar[tuple[str, ...]] = ()  # two keys, of which exactly one is required
    above_zero: ClassVar[tuple[str, ...]] = ()  # keys whose values must be positive

    @model_validator(mode="after")
    def _keys_fit(self) -> Self:
        if self.either and sum(getattr(self, key) is not None for key in self.either) != 1:
            raise wrong("config.not_one_key", keys=self.either)
        for key in self.above_zero:
            if (value := getattr(self, key)) is not None and not np.all(np.asarray(value) > 0.0):
                raise wrong("config.not_above_zero", key=key)
        return self


def read_short(path: Path) -> bytes:
    """Read a file of at most `MAX_BYTES`.

    Raises: ConfigError: it cannot be read, or is too long.
    """
    where = str(path)
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise ConfigError("config.unreadable", where=where, reason=reason_of(error)) from None
    if len(content) > MAX_BYTES:
        raise ConfigError("config.too_long", where=where, limit=MAX_BYTES)
    return content


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file. Raises: ConfigError: as in `read_short`, or the file is not valid TOML."""
    where = str(path)
    try:
        text = read_short(path).decode("utf-8-sig")
        if _LONG_KEY.search(_NO_KEY.sub("_", text)):
            raise RecursionError  # as tomllib does for nested brackets
        return tomllib.loads(text)
    except RecursionError:
        raise ConfigError("config.too_nested", where=where) from None
    except ValueError as error:
        raise ConfigError("config.no_toml", where=where, reason=str(error)) from None


def validate(model: type[Model], data: dict[str, Any], where: str) -> Model:
    """Check the content of a TOML file against its model.

    `where`: file to name in the error.
    Raises: ConfigError: the content is invalid. It lists all errors, each with the dotted name of its key.
    """
    content, problems = checked(model, data)
    if content is None:
        refuse(problems, where)
    return content


def checked(model: type[Model], data: dict[str, Any]) -> tuple[Model | None, list[ConfigError]]:
    """Check a table against its model; return the checked content or None, and the errors."""
    try:
        return model.model_validate(data), []
    except ValidationError as error:
        errors = error.errors(include_url=False, include_input=False)
        unknown = [details for details in errors if details["type"] == "extra_forbidden"]
        without_unknown: Any = copy.deepcopy(data)
        for *parents, key in (details["loc"] for details in unknown):
            del functools.reduce(lambda table, name: table[name], parents, without_unknown)[key]
        # pydantic does not check the values of a table with an unknown key: check again without unknown keys
        further = checked(model, without_unknown)[1] if unknown else [_problem(model, details) for details in errors]
        return None, [*(_problem(model, details) for details in unknown), *further]


def refuse(problems: list[ConfigError], where: str) -> NoReturn:
    """Raise one error that contains all errors of a file. Each of them has a key of the file as its location."""
    if len(problems) == 1:
        problems[0].where = ": ".join(filter(None, (where, problems[0].where)))
        raise problems[0]
    raise ConfigError("config.several_errors", where=where, count=len(problems), problems=tuple(problems))


def scalar(dimension: str, *, signed: bool = False) -> PlainValidator:
    """Build a validator of a quantity with a dimension of `insnav.units.UNITS`; negative values need `signed`."""
    return PlainValidator(lambda value: quantity(value, dimension, signed=signed))


def signed_scalar(dimension: str) -> PlainValidator:
    """Build a validator of a quantity of either sign with a dimension of `insnav.units.UNITS`."""
    return scalar(dimension, signed=True)


def axes(dimension: str, *, signed: bool = False) -> PlainValidator:
    """Build a validator of one quantity for all three axes, or of a list of three quantities; see `scalar`."""

    def check(value: object) -> Axes:
        if isinstance(value, list):
            if len(value) != 3:
                raise wrong("config.not_by_axis", count=len(value))
            x, y, z = (quantity(item, dimension, signed=signed) for item in value)
            return x, y, z
        single = quantity(value, dimension, signed=signed)
        return single, single, single

    return PlainValidator(check)


def matrix_of(dimension: str = "") -> PlainValidator:
    """Build a validator of three rows of three quantities of either sign, or of numbers without dimension."""

    def check(value: object) -> Matrix:
        rows = value if isinstance(value, list) else []
        if len(rows) != 3 or any(not isinstance(row, list) or len(row) != 3 for row in rows):
            raise wrong("config.no_matrix_of_quantities" if dimension else "config.no_matrix_of_numbers")
        (a, b, c), (d, e, f), (g, h, i) = (
            [quantity(item, dimension, signed=True) if dimension else number(item) for item in row] for row in rows
        )
        return (a, b, c), (d, e, f), (g, h, i)

    return PlainValidator(check)


def with_fields(base: type[Model], fields: Mapping[str, PlainValidator | type[Table]]) -> type[Model]:
    """Derive a table model with further optional keys, each a validator or a table model; replace existing keys."""
    definitions: dict[str, Any] = {
        key: (kind | None if isinstance(kind, type) else Annotated[Any, kind], None) for key, kind in fields.items()
    }
    return create_model(base.__name__, __base__=base, **definitions)


def number(value: object) -> float:
    """Convert a TOML value to a finite number, for validators."""
    try:
        converted = math.nan if isinstance(value, bool) or not isinstance(value, int | float) else float(value)
    except OverflowError:
        converted = math.inf
    if not math.isfinite(converted):
        raise wrong("config.no_finite_number")
    return converted


def quantity(value: object, dimension: str, *, signed: bool) -> float:
    """Convert a quantity to SI and radians, for validators.

    `value`: from the file. `dimension`: as in `insnav.units.UNITS`. `signed`: allow negative values.
    Raises: PydanticCustomError: `value` is not a text with a number and a unit of this dimension.
    """
    if not isinstance(value, str):
        raise wrong("config.no_quantity", unit=units_of(dimension)[0], kind=_kind(value))
    if len(value) > MAX_TEXT:
        raise wrong("config.text_too_long", text=value[:20], count=len(value), limit=MAX_TEXT)
    try:
        converted = parse_quantity(value.strip(), dimension)
    except ConfigError as error:
        raise _as_pydantic(error) from None
    if converted < 0.0 and not signed:
        raise wrong("config.negative", text=value)
    return converted


def text(value: ArrayLike, unit: str) -> Any:
    """Write a quantity in SI as text in a unit, for `parse_quantity`; each element of a list or matrix separately.

    Returns: one text for three equal axes. SI units keep every bit, other units 15 digits.
    """
    if np.ndim(value) == 2:
        return [[text(item, unit) for item in row] for row in np.asarray(value)]
    if np.ndim(value) == 1:
        texts = [text(item, unit) for item in np.asarray(value)]
        return texts[0] if len(texts) == 3 and len(set(texts)) == 1 else texts
    number, factor = float(np.asarray(value)), UNITS[unit][1]
    short = f"{number / factor:.15g}"
    return f"{number!r} {unit}" if factor == 1.0 and float(short) != number else f"{short} {unit}"


def preset_or_file(given: str, folder: Path, presets: Sequence[str]) -> Path | None:
    """Find the file of a preset, by its name in `folder`, or another file by its path; None if neither exists."""
    if given in presets:
        return folder / f"{given}.toml"
    path = Path(given)
    try:
        return path if path.exists() else None
    except (OSError, ValueError):  # for example, the name is too long for the file system
        return None


def similar(name: str, known: Iterable[str]) -> dict[str, Any]:
    """Return values for the error on an unknown name: ``close``, a similar known name, or else ``known``, all names."""
    known = tuple(known)
    close = difflib.get_close_matches(name, known, n=1)
    return {"close": close[0]} if close else {"known": known}


def wrong(code: str, **values: Any) -> PydanticCustomError:
    """Build the exception that a validator raises for an error of insnav."""
    return _as_pydantic(ConfigError(code, **values))


def _as_pydantic(error: ConfigError) -> PydanticCustomError:
    return PydanticCustomError("wrong_value", "see its context", {"error": error})


def _kind(value: object) -> str:
    """Name the kind of a TOML value, without its content, which may be of any length."""
    kinds = {bool: "true or false", int: "a number", float: "a number", list: "a list", dict: "a table", str: "a text"}
    return kinds.get(type(value), "a date")


def _problem(model: type[Table], details: ErrorDetails) -> ConfigError:
    """Convert a pydantic error to an error of insnav."""
    path, kind, context = details["loc"], details["type"], details.get("ctx", {})
    key = "".join(f" {part + 1}" if isinstance(part, int) else f".{part}" for part in path).lstrip(". ")
    if kind == "extra_forbidden":
        name = str(path[-1])
        return ConfigError("config.unknown_key", where=key, key=name[:100], **similar(name, _keys(model, path[:-1])))
    if kind in ("model_type", "model_attributes_type"):
        return ConfigError("config.no_table", where=key, key=key)
    if kind == "string_type":
        return ConfigError("config.no_text", where=key)
    if kind == "missing":
        return ConfigError("config.missing_key", where=key, key=str(path[-1]))
    if kind == "literal_error":
        return ConfigError("config.no_choice", where=key, known=tuple(re.findall("'(.*?)'", context["expected"])))
    if kind in _KINDS:
        return ConfigError("config.other_kind", where=key, kind=_KINDS[kind])
    for name, relation in _RELATIONS.items():
        if name in context:
            values = {"relation": relation, "limit": context[name], "count": context.get("actual_length")}
            return ConfigError(
                "config.list_length" if "actual_length" in context else "config.out_of_range", where=key, **values
            )
    cause = context.get("error")
    if not isinstance(cause, ConfigError):
        return ConfigError("config.invalid_value", where=key, reason=details["msg"])
    cause.where = key
    return cause


def _keys(model: type[BaseModel], path: tuple[int | str, ...]) -> list[str]:
    """List the known keys of the table at `path`."""
    for part in path:
        if isinstance(part, int):  # the number of a table in a list of tables
            continue
        annotation = model.model_fields[str(part)].annotation
        types = (annotation, *getattr(annotation, "__args__", ()))
        model = next(item for item in types if isinstance(item, type) and issubclass(item, BaseModel))
    return list(model.model_fields)
