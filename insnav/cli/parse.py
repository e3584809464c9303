"""Conversion of option texts to values, with errors that name the option."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from insnav.exceptions import ConfigError

if TYPE_CHECKING:
    from insnav.types import FloatArray


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


def finite(value: float, option: str, *, largest: float = math.inf) -> float:
    """Accept a number that is finite and not implausibly large."""
    if not math.isfinite(value) or abs(value) > largest:
        raise ConfigError("cli.not_sensible", where=option, value=value)
    return value


def not_negative(value: float, option: str, *, largest: float = math.inf) -> float:
    """Accept a number that is zero or more and not implausibly large."""
    if finite(value, option, largest=largest) < 0.0:
        raise ConfigError("cli.negative", where=option, value=value)
    return value


def interval(rate: str) -> float:
    """Parse the seconds between rows of the solution; 0 for every sample."""
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
    """Parse quantity to header, ``gyro_x=Gx,time_s=t``; ``sd_n=`` excludes that quantity."""
    if text is None:
        return None
    pairs = [part.split("=", 1) for part in text.split(",")]
    if any(len(pair) != 2 or not pair[0] for pair in pairs):
        raise ConfigError("cli.not_names", where=option, text=text)
    return {name.strip(): header.strip() for name, header in pairs}


def weights(text: str | None, option: str) -> dict[str, float] | None:
    """Parse names and numbers above zero, ``gyro bias=8,accel bias=2``."""
    pairs = columns(text, option)
    return None if pairs is None else {name: positive_numbers(value, option)[0] for name, value in pairs.items()}


def named_numbers(text: str | None, option: str, example: str) -> dict[str, float] | None:
    """Parse names and numbers, ``x2=-0.01,z1=0.02``."""
    pairs = columns(text, option)
    return None if pairs is None else {name: numbers(v, option, 1, example)[0].item() for name, v in pairs.items()}


def configuration(options: dict[str, Any]) -> dict[str, Any]:
    """Return the specified options for run.json, except options without effect on its content."""
    kept = {name: value for name, value in options.items() if name not in ("out", "force", "as_json", "engine")}
    return {name: str(value) if isinstance(value, Path) else value for name, value in kept.items()}


def usage_error(error: Any) -> ConfigError:
    """Convert an error of the option parser to an error of insnav."""
    context, parameter = getattr(error, "ctx", None), getattr(error, "param", None)
    command = context.command_path if context is not None else "insnav"
    match type(error).__name__:  # typer hides these classes: its own, or click's
        case "NoSuchOption":
            similar = tuple(sorted(error.possibilities or ()))
            return ConfigError("cli.no_such_option", option=error.option_name, similar=similar, command=command)
        case "MissingParameter" if parameter is not None:
            name = parameter.opts[0]
            named = name if name.startswith("-") else parameter.metavar or name.upper()
            return ConfigError("cli.missing_option", option=named, command=command)
    return ConfigError("cli.usage", problem=error.format_message().rstrip("."), command=command)
