"""Options: declarations with help texts, which several commands may share, and conversion of texts to values."""

from __future__ import annotations

import inspect
import math
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_origin

import typer

from insnav.exceptions import ConfigError
from insnav.library import library

if TYPE_CHECKING:
    from insnav.types import FloatArray

FILES = "Files"  # help group of options for files
# options whose value may be a library name, by help group and placeholder: folders of the library, () for profiles
_NAMED: dict[tuple[str, str | None], tuple[str, ...]] = {
    ("IMU", "MODEL"): ("imu/grades", "imu/parts"),
    ("IMU", "PART"): ("imu/parts",),
    ("GPS", "MODEL"): ("simulate/receivers",),
    ("Motion", "PROFILE"): (),
}


def option(group: str, value: str | None, meaning: str, *names: str, **more: Any) -> Any:
    """Declare an option.

    `group`: group in the help. `value`: placeholder of the value, None for a flag. `names`: names of the option, if
    they differ from the parameter's name. `more`: arguments of `typer.Option`.
    """
    named = _named(group, value)
    return typer.Option(*names, metavar=value, help=meaning, rich_help_panel=group, autocompletion=named, **more)


def argument(value: str, meaning: str, group: str = FILES) -> Any:
    """Declare an argument."""
    named = _named(group, value)
    return typer.Argument(metavar=value, help=meaning, rich_help_panel=group, autocompletion=named)


def _named(group: str, value: str | None) -> Callable[[str], list[str]] | None:
    """Return the function that completes library names, or None; the shell completes file names itself."""
    if (folders := _NAMED.get((group, value))) is None:
        return None

    def begun(incomplete: str) -> list[str]:
        files = [file for name in folders for file in (Path(__file__).parents[1] / name).glob("*.toml")] or library()
        stems = sorted(file.stem for file in files if file.stem.startswith(incomplete.lower()))
        return [incomplete + stem[len(incomplete) :] for stem in stems]  # keep typed letters, maybe capitals

    return begun


def _engine(text: str) -> str:  # checks an engine before anything is computed
    from insnav.engine import engine_of

    engine_of(text)
    return text


def _force(context: typer.Context, value: bool) -> bool | Literal["keep"]:
    """Return --force, or ``keep`` for the default folder without it; see `insnav.output.folder.RunFolder`."""
    source = context.get_parameter_source("out")
    default = source is not None and source.name == "DEFAULT" and context.params.get("out") is not None
    return value or ("keep" if default else False)


_CALLBACKS: dict[str, Callable[..., Any]] = {"engine": _engine, "force": _force}


@cache
def _texts() -> dict[str, dict[str, dict[str, Any]]]:
    return tomllib.loads(Path(__file__).with_name("options.toml").read_text(encoding="utf-8"))


def declared(function: Callable[..., None], command: str) -> Callable[..., None]:
    """Declare the parameters of a command as in ``options.toml``; typer reads the signature.

    `command`: such as ``run`` or ``calibrate/gyro``. Its group and all commands share texts.
    """
    tables = [_texts().get(name, {}) for name in (command, command.partition("/")[0], "shared")]
    annotated: Any = Annotated  # untyped: the type checker does not know the type
    parameters = []
    for param in inspect.signature(function, eval_str=True).parameters.values():
        texts = next((table[param.name] for table in tables if param.name in table), None)
        if texts is not None and get_origin(param.annotation) is not Annotated:
            param = param.replace(annotation=annotated[param.annotation, _declaration(param.name, **texts)])
        parameters.append(param)
    function.__dict__["__signature__"] = inspect.Signature(parameters)
    function.__annotations__ = {param.name: param.annotation for param in parameters}
    return function


def _declaration(parameter: str, help: str, group: str, value: str | None = None, **how: Any) -> Any:
    if how.pop("argument", False):
        return argument(value or "", help, group)
    names = (how.pop("name"),) if "name" in how else ()
    return option(group, value, help, *names, callback=_CALLBACKS.get(parameter), **how)


def _numbers(text: str, separator: str, count: int, option: str, example: str) -> list[float]:
    parts = text.split(separator)
    try:
        values = [float(part) for part in parts]
    except ValueError:
        values = []
    if len(values) != count or not all(math.isfinite(v) for v in values):
        raise ConfigError("cli.not_numbers", where=option, option=option, text=text, count=count, example=example)
    return values


def positive_numbers(text: str, option: str, example: str = "10,60") -> list[float]:
    """Parse comma-separated numbers above zero."""
    values = _numbers(text, ",", text.count(",") + 1, option, example)
    if not all(value > 0.0 for value in values):
        raise ConfigError("cli.not_positive", where=option, text=text)
    return values


def vector(text: str, option: str) -> tuple[float, ...]:
    """Parse three numbers in metres, such as a lever arm."""
    return tuple(_numbers(text, ",", 3, option, "0.136,-0.301,-0.184"))


def numbers(text: str, option: str, count: int, example: str) -> FloatArray:
    """Parse `count` comma-separated numbers, in the unit of the option."""
    import numpy as np

    return np.array(_numbers(text, ",", count, option, example))


def span(text: str, option: str) -> tuple[float, float]:
    """Parse start and end of a time interval in seconds."""
    begin, end = _numbers(text, ":", 2, option, "0:300")
    if not end > begin:
        raise ConfigError("cli.span_backward", where=option, option=option, text=text)
    return begin, end


def number_in(unit: str, option: str, text: str) -> float:
    """Convert a text to a number in `unit`; the text may have another unit of the same dimension: ``150 ms``."""
    try:
        return float(text)
    except ValueError:
        from insnav.config_file import parse_quantity
        from insnav.units import UNITS

        dimension, size = UNITS[unit]
        return parse_quantity(text, dimension, where=option) / size


def finite(value: float, option: str, *, largest: float = math.inf) -> float:
    """Return a number; raise a ConfigError unless it is finite and at most `largest`, in magnitude."""
    if not math.isfinite(value) or abs(value) > largest:
        raise ConfigError("cli.not_sensible", where=option, value=value)
    return value


def not_negative(value: float, option: str, *, largest: float = math.inf) -> float:
    """Return a number; raise a ConfigError unless it is at least zero and at most `largest`."""
    if finite(value, option, largest=largest) < 0.0:
        raise ConfigError("cli.negative", where=option, value=value)
    return value


def interval(rate: str) -> float:
    """Convert a rate [Hz] to the time between rows of the solution [s]; 0 for ``full``: every sample."""
    if rate == "full":
        return 0.0
    try:
        value = float(rate)
    except ValueError:
        value = 0.0
    if not 0.01 <= value <= 10000.0:
        raise ConfigError("cli.not_a_rate", where="--rate", text=str(rate))
    return 1.0 / value


def columns(text: str | None, option: str) -> dict[str, str] | None:
    """Parse pairs of quantity and column header, ``gyro_x=Gx,time_s=t``; ``sd_n=`` excludes a quantity."""
    if text is None:
        return None
    pairs = [part.split("=", 1) for part in text.split(",")]
    if any(len(pair) != 2 or not pair[0] for pair in pairs):
        raise ConfigError("cli.not_names", where=option, text=text)
    return {name.strip(): header.strip() for name, header in pairs}


def weights(text: str | None, option: str) -> dict[str, float] | None:
    """Parse pairs of name and number above zero, ``gyro bias=8,accel bias=2``."""
    pairs = columns(text, option)
    return None if pairs is None else {name: positive_numbers(value, option)[0] for name, value in pairs.items()}


def named_numbers(text: str | None, option: str, example: str) -> dict[str, float] | None:
    """Parse pairs of name and number, ``x2=-0.01,z1=0.02``."""
    pairs = columns(text, option)
    return None if pairs is None else {name: numbers(v, option, 1, example)[0].item() for name, v in pairs.items()}


def configuration(options: dict[str, Any]) -> dict[str, Any]:
    """Return the specified options for run.json, except options without effect on the result."""
    kept = {name: value for name, value in options.items() if name not in ("out", "force", "as_json", "engine")}
    return {name: str(value) if isinstance(value, Path) else value for name, value in kept.items()}


def usage_error(error: Any) -> ConfigError:
    """Convert an error of the option parser to an error of insnav."""
    context, parameter = getattr(error, "ctx", None), getattr(error, "param", None)
    command = context.command_path if context is not None else "insnav"
    match type(error).__name__:  # compares names, since typer hides these classes: its own, or click's
        case "NoSuchOption":
            similar = tuple(sorted(error.possibilities or ()))
            return ConfigError("cli.no_such_option", option=error.option_name, similar=similar, command=command)
        case "MissingParameter" if parameter is not None:
            name = parameter.opts[0]
            named = name if name.startswith("-") else parameter.metavar or name.upper()
            return ConfigError("cli.missing_option", option=named, command=command)
    return ConfigError("cli.usage", problem=error.format_message().rstrip("."), command=command)
