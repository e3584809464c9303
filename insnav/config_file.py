"""What the IMU files have in common: reading TOML, quantities as text, and telling all errors at once."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from pydantic import BaseModel, ConfigDict, PlainValidator, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from insnav.exceptions import ConfigError
from insnav.units import parse_quantity, units_of

MAX_BYTES = 1_000_000  # an IMU file has one or two kB
MAX_TEXT = 100  # longest sensible "number unit"

Axes = tuple[float, float, float]
Model = TypeVar("Model", bound="Table")

# bias random walks have the unit of the bias over the root of a time
_PER_ROOT_TIME = {"/sqrt(s)": 1.0, "/sqrt(h)": 60.0}


class Table(BaseModel):
    """A TOML table in which an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", strict=True)


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Parameters
    ----------
    path : Path
        File to read, at most `MAX_BYTES` long.

    Returns
    -------
    dict
        Its content.

    Raises
    ------
    ConfigError
        It cannot be read, is too long, or is no TOML.
    """
    where = str(path)
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read {where!r}", where=where, why=_reason(error)) from None
    if len(content) > MAX_BYTES:
        raise ConfigError(f"{where!r} is too long", where=where, why=f"it has more than {MAX_BYTES} bytes")
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        why = "tables nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise ConfigError(f"{where!r} is not a TOML file", where=where, why=why) from None


def validate(model: type[Model], data: dict[str, Any], where: str) -> Model:
    """Check the content of a TOML file against its model.

    Parameters
    ----------
    model : type
        The model, a `Table`.
    data : dict
        What the file holds.
    where : str
        File to name in the error.

    Returns
    -------
    Table
        The checked content.

    Raises
    ------
    ConfigError
        All errors at once, each with the dotted name of its key.
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


def scalar(dimension: str) -> PlainValidator:
    """Make a validator of one quantity that is not negative.

    Parameters
    ----------
    dimension : str
        Dimension as in `insnav.units.UNITS`.
    """
    return PlainValidator(lambda value: quantity(value, dimension, signed=False))


def signed_scalar(dimension: str) -> PlainValidator:
    """Make a validator of one quantity of either sign.

    Parameters
    ----------
    dimension : str
        Dimension as in `insnav.units.UNITS`.
    """
    return PlainValidator(lambda value: quantity(value, dimension, signed=True))


def axes(dimension: str, *, signed: bool = False, per_root_time: bool = False) -> PlainValidator:
    """Make a validator of one quantity for all axes or a list of one per axis.

    Parameters
    ----------
    dimension : str
        Dimension as in `insnav.units.UNITS`.
    signed : bool
        Whether negative values make sense.
    per_root_time : bool
        Whether the unit is that dimension over ``sqrt(s)`` or ``sqrt(h)``.
    """

    def check(value: object) -> Axes:
        if isinstance(value, list):
            if len(value) != 3:
                raise _wrong(f"needs one value or three (x, y, z), not {len(value)}")
            x, y, z = (quantity(item, dimension, signed=signed, per_root_time=per_root_time) for item in value)
            return x, y, z
        single = quantity(value, dimension, signed=signed, per_root_time=per_root_time)
        return single, single, single

    return PlainValidator(check)


def quantity(value: object, dimension: str, *, signed: bool, per_root_time: bool = False) -> float:
    """Value of one quantity in SI, for validators.

    Parameters
    ----------
    value : object
        What stands in the file.
    dimension : str
        Dimension as in `insnav.units.UNITS`.
    signed : bool
        Whether negative values make sense.
    per_root_time : bool
        Whether the unit is that dimension over ``sqrt(s)`` or ``sqrt(h)``.

    Raises
    ------
    PydanticCustomError
        It is none.
    """
    example = units_of(dimension)[0] + ("/sqrt(s)" if per_root_time else "")
    if not isinstance(value, str):
        raise _wrong(f'must be a text with a unit, like "1.5 {example}", not {_kind(value)}')
    if len(value) > MAX_TEXT:
        raise _wrong(f"is too long: {value[:20]!r}… has {len(value)} characters")
    text, divisor = value.strip(), 1.0
    if per_root_time:
        ending = next((ending for ending in _PER_ROOT_TIME if text.endswith(ending)), None)
        if ending is None:
            raise _wrong(f'{value!r} must end in "/sqrt(s)" or "/sqrt(h)", like "1.5 {example}"')
        text, divisor = text.removesuffix(ending), _PER_ROOT_TIME[ending]
    try:
        number = parse_quantity(text, dimension) / divisor
    except ConfigError as error:
        raise _wrong(", ".join(part for part in (error.what, error.why, error.fix) if part)) from None
    if number < 0.0 and not signed:
        raise _wrong(f"{value!r} is negative, and must not be")
    return number


def _wrong(message: str) -> PydanticCustomError:
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


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)
