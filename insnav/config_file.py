"""Configuration files in TOML: presets by name, quantities as text with their unit, all errors reported at once."""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, NoReturn, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, PlainValidator, ValidationError, create_model, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from insnav.exceptions import ConfigError, reason_of
from insnav.quantity_text import parse_quantity
from insnav.units import UNITS, units_of

MAX_BYTES = 1_000_000  # an IMU file has one or two kB
MAX_TEXT = 100  # longest sensible "number unit"

Axes = tuple[float, float, float]
Matrix = tuple[Axes, Axes, Axes]
Model = TypeVar("Model", bound="Table")


class Table(BaseModel):
    """A TOML table in which an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", strict=True)
    either: ClassVar[tuple[str, ...]] = ()  # two keys of which exactly one is needed
    above_zero: ClassVar[tuple[str, ...]] = ()

    @model_validator(mode="after")
    def _keys_fit(self) -> Self:
        if self.either and sum(getattr(self, key) is not None for key in self.either) != 1:
            raise wrong(f"needs either {' or '.join(self.either)}")
        for key in self.above_zero:
            if (value := getattr(self, key)) is not None and not np.all(np.asarray(value) > 0.0):
                raise wrong(f"{key} must be above zero")
        return self


def read_toml(path: Path) -> dict[str, Any]:
    """Content of a TOML file, at most `MAX_BYTES` long.

    Raises: ConfigError: it cannot be read, is too long, or is no TOML.
    """
    where = str(path)
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read {where!r}", where=where, why=reason_of(error)) from None
    if len(content) > MAX_BYTES:
        raise ConfigError(f"{where!r} is too long", where=where, why=f"it has more than {MAX_BYTES} bytes")
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        why = "tables nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise ConfigError(f"{where!r} is not a TOML file", where=where, why=why) from None


def validate(model: type[Model], data: dict[str, Any], where: str) -> Model:
    """Check the content of a TOML file against its model.

    `where`: file to name in the error.
    Raises: ConfigError: all errors at once, each with the dotted name of its key.
    """
    found, problems = checked(model, data)
    if found is None:
        refuse(problems, where)
    return found


def checked(model: type[Model], data: dict[str, Any]) -> tuple[Model | None, list[str]]:
    """Check a table against its model without an error yet: the checked content, or what is wrong with it."""
    try:
        return model.model_validate(data), []
    except ValidationError as error:
        return None, [_problem(model, details) for details in error.errors(include_url=False, include_input=False)]


def refuse(problems: list[str], where: str) -> NoReturn:
    """Say everything that is wrong with a file at once."""
    if len(problems) == 1:
        raise ConfigError(problems[0], where=where)
    raise ConfigError(f"{len(problems)} things are wrong", where=where, why="\n".join(problems))


def scalar(dimension: str, *, signed: bool = False) -> PlainValidator:
    """Make a validator of one quantity, negative only if `signed`; its dimension as in `insnav.units.UNITS`."""
    return PlainValidator(lambda value: quantity(value, dimension, signed=signed))


def signed_scalar(dimension: str) -> PlainValidator:
    """Make a validator of one quantity of either sign; its dimension as in `insnav.units.UNITS`."""
    return scalar(dimension, signed=True)


def axes(dimension: str, *, signed: bool = False) -> PlainValidator:
    """Make a validator of one quantity for all axes or a list of one per axis; see `scalar`."""

    def check(value: object) -> Axes:
        if isinstance(value, list):
            if len(value) != 3:
                raise wrong(f"needs one value or three (x, y, z), not {len(value)}")
            x, y, z = (quantity(item, dimension, signed=signed) for item in value)
            return x, y, z
        single = quantity(value, dimension, signed=signed)
        return single, single, single

    return PlainValidator(check)


def matrix_of(dimension: str = "") -> PlainValidator:
    """Make a validator of three rows of three quantities of either sign, or of numbers if there is no dimension."""

    def check(value: object) -> Matrix:
        rows = value if isinstance(value, list) else []
        if len(rows) != 3 or any(not isinstance(row, list) or len(row) != 3 for row in rows):
            raise wrong(f"must be three rows of three {'quantities' if dimension else 'numbers'}, [[…], […], […]]")
        (a, b, c), (d, e, f), (g, h, i) = (
            [quantity(item, dimension, signed=True) if dimension else number(item) for item in row] for row in rows
        )
        return (a, b, c), (d, e, f), (g, h, i)

    return PlainValidator(check)


def with_fields(base: type[Model], fields: Mapping[str, PlainValidator | type[Table]]) -> type[Model]:
    """Add optional keys to a table: quantities by their validators, or tables; a key that is there is replaced."""
    found: dict[str, Any] = {
        key: (of | None if isinstance(of, type) else Annotated[Any, of], None) for key, of in fields.items()
    }
    return create_model(base.__name__, __base__=base, **found)


def number(value: object) -> float:
    """Finite number of a TOML value, for validators."""
    try:
        found = math.nan if isinstance(value, bool) or not isinstance(value, int | float) else float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise wrong("must be finite numbers without quotes")
    return found


def quantity(value: object, dimension: str, *, signed: bool) -> float:
    """Value of one quantity in SI and radians, for validators.

    `value`: what stands in the file; `dimension`: as in `insnav.units.UNITS`; `signed`: whether negative values make
    sense.
    Raises: PydanticCustomError: it is none.
    """
    if not isinstance(value, str):
        raise wrong(f'must be a text with a unit, like "1.5 {units_of(dimension)[0]}", not {_kind(value)}')
    if len(value) > MAX_TEXT:
        raise wrong(f"is too long: {value[:20]!r}… has {len(value)} characters")
    try:
        found = parse_quantity(value.strip(), dimension)
    except ConfigError as error:
        raise wrong(" ".join(part for part in (error.what, error.why, error.fix) if part)) from None
    if found < 0.0 and not signed:
        raise wrong(f"{value!r} is negative, and must not be")
    return found


def text(value: ArrayLike, unit: str) -> Any:
    """Write a quantity in SI, or a list of them, in a unit, as the readers above take it.

    Returns: one text for three axes if they are equal. In SI units every bit is kept, in others 15 digits.
    """
    if np.ndim(value) == 2:
        return [[text(item, unit) for item in row] for row in np.asarray(value)]
    if np.ndim(value) == 1:
        texts = [text(item, unit) for item in np.asarray(value)]
        return texts[0] if len(texts) == 3 and len(set(texts)) == 1 else texts
    number, factor = float(np.asarray(value)), UNITS[unit][1]
    short = f"{number / factor:.15g}"
    return f"{number!r} {unit}" if factor == 1.0 and float(short) != number else f"{short} {unit}"


def preset_or_file(
    given: str, folder: Path, presets: Sequence[str], what: str, option: str, more: Callable[[], str] = str
) -> Path:
    """File of a preset in a folder, or the file itself.

    `given`: name of a preset or path; `what`, `option`, `more`: what it is, the option that gives it and what else this
    may be, for the error.
    Raises: ConfigError: it is neither.
    """
    if given in presets:
        return folder / f"{given}.toml"
    path = Path(given)
    try:
        found = path.exists()
    except (OSError, ValueError):  # too long a name, for one
        found = False
    if found:
        return path
    close = difflib.get_close_matches(given, presets, n=1)
    raise ConfigError(
        f"{given[:200]!r} is neither {what} preset nor a file",
        where=option,
        fix=f"did you mean {close[0]!r}?" if close else f"presets are {', '.join(presets)}{more()}",
    )


def wrong(message: str) -> PydanticCustomError:
    """Error that a validator raises."""
    # the message goes through a format string: as a value of it, braces in it stay braces
    return PydanticCustomError("wrong_value", "{message}", {"message": message})


def _kind(value: object) -> str:
    """Name the kind of a TOML value, without its content, which may be of any length."""
    kinds = {
        bool: "true or false",
        int: "a number",
        float: "a number",
        list: "a list",
        dict: "a table",
        str: "a text",
    }
    return kinds.get(type(value), "a date")


def _problem(model: type[Table], details: ErrorDetails) -> str:
    """One error of pydantic in our words."""
    path, kind = details["loc"], details["type"]
    key = "".join(f" {part + 1}" if isinstance(part, int) else f".{part}" for part in path).lstrip(". ")
    if kind == "extra_forbidden":
        known = _keys(model, path[:-1])
        close = difflib.get_close_matches(str(path[-1]), known, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"known are {', '.join(known)}"
        return f"{key}: unknown key, {hint}"
    if kind in ("model_type", "model_attributes_type"):
        return f"{key}: must be a table, [{key}]"
    if kind == "string_type":
        return f"{key}: must be a text in quotes"
    if kind == "missing":
        return f"{key}: is missing"
    return f"{key}: {details['msg']}" if key else details["msg"]


def _keys(model: type[BaseModel], path: tuple[int | str, ...]) -> list[str]:
    """Known keys of the table at `path`."""
    for part in path:
        if isinstance(part, int):  # a row of a list of tables
            continue
        annotation = model.model_fields[str(part)].annotation
        candidates = (annotation, *getattr(annotation, "__args__", ()))
        model = next(item for item in candidates if isinstance(item, type) and issubclass(item, BaseModel))
    return list(model.model_fields)
