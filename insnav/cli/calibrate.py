"""``insnav calibrate``: calibration file from bench data, one command per method."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from insnav.cli import parse
from insnav.cli.console import note, result_page, working, write_result
from insnav.cli.data_options import READING, Data, say_reading, takes_data
from insnav.cli.help import GroupedCommand, LightGroup, help_of
from insnav.cli.options import METHOD, RESULT, Columns, Force, Json, Out, SpikeLimit, argument, flag, option

if TYPE_CHECKING:
    from insnav.input.readers.reading import Reading
    from insnav.types import ImuData


OUT = Path("calibration")
Gravity = Annotated[float, option(METHOD, "M/S2", "Local gravity.")]
Name = Annotated[str, option(RESULT, "TEXT", "Name of the calibrated sensor.")]
Add = Annotated[
    Path | None, option(RESULT, "FILE", "A calibration.toml with the other triad, to copy into the new file.")
]
_KEYWORD = inspect.Parameter.KEYWORD_ONLY
_KINDS: tuple[tuple[str, Any, Any], ...] = (
    *(("columns", Columns, None), ("gravity", Gravity, 9.80665), ("spike_limit", SpikeLimit, None)),
    *(("add", Add, None), ("name", Name, ""), ("out", Out, OUT), ("force", Force, False), ("as_json", Json, False)),
)
_SHARED = {name: inspect.Parameter(name, _KEYWORD, default=value, annotation=kind) for name, kind, value in _KINDS}

app = typer.Typer(
    cls=LightGroup,
    name="calibrate",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _command(method: str, *shared: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Build the command of a method, with help. Its ``**how`` is replaced by the `shared` and result options."""

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        own = dict(inspect.signature(function, eval_str=True).parameters)
        if own.pop("how", None):
            first, *rest = (each.replace(kind=_KEYWORD) for each in own.values())
            shown = [_SHARED[name] for name in (*shared, "out", "force", "as_json")]
            every = [first, *shown[:-3], *rest, *shown[-3:]]
            function.__dict__["__signature__"] = inspect.Signature(every)
            function.__annotations__ = {each.name: each.annotation for each in every}
        return app.command(method, cls=GroupedCommand, **help_of(f"calibrate/{method}"))(function)

    return decorate


@_command("gyro", "columns", "spike_limit", "add", "name")
def gyro(
    files: Annotated[list[Path], argument("FILE", "Rate table of x, y, z, or one.")],
    keep: Annotated[
        str | None, option(METHOD, "FROM:TO", "Rates to use, deg/s. [all that are linear]", "--range")
    ] = None,
    **how: Any,
) -> None:
    """Calibrate gyros on a rate table."""
    _calibrate("gyro", {"files": files, "keep": parse.span(keep, "--range") if keep else None, **how})


@_command("accel", "columns", "gravity", "spike_limit", "add", "name")
def accel(files: Annotated[list[Path], argument("FILE", "Tumble test of x, y, z, or one.")], **how: Any) -> None:
    """Calibrate accelerometers by tumbling."""
    _calibrate("accel", {"files": files, **how})


@_command("imu", "columns", "spike_limit", "add", "name")
def imu(
    files: Annotated[list[Path], argument("FILE", "Sweeps about x, y, z, or one.")],
    intercepts: Annotated[
        str | None,
        option(METHOD, "PIECE=DEG/S,…", "Intercepts b' set by hand; x2 is the second piece of gyro x.", "--intercept"),
    ] = None,
    **how: Any,
) -> None:
    """Calibrate three gyros by sweeps."""
    pieces = parse.named_numbers(intercepts, "--intercept", "-0.01")
    _calibrate("imu", {"files": files, "intercepts": pieces, **how})


@_command("nine", "columns", "gravity", "name")
def nine(files: Annotated[Path, argument("FILE", "Table of positions.")], **how: Any) -> None:
    """Calibrate dual-axis modules."""
    _calibrate("nine", {"files": files, **how})


@_command("poses")
@takes_data(files={}, only=READING)
def poses(
    data: Data,
    method: Annotated[
        Literal["poses", "six"], option(METHOD, "HOW", "How it was recorded: poses, or six (Ferraris).")
    ] = "poses",
    counts: Annotated[bool, flag(METHOD, "--counts", "The file holds raw counts or volts, not SI units.")] = False,
    gravity: Annotated[float | None, option(METHOD, "M_S2", "Gravity at the bench, m/s^2.")] = None,
    lat: Annotated[float | None, option(METHOD, "DEG", "Latitude, if gravity is not given.")] = None,
    height: Annotated[float, option(METHOD, "M", "Height above the ellipsoid.")] = 0.0,
    sections: Annotated[
        Path | None,
        option(
            METHOD,
            "FILE",
            "First and last sample of x_p (x up), x_a (x down), …, x_rot, … for six (JSON or TOML). [found]",
        ),
    ] = None,
    turn: Annotated[float, option(METHOD, "DEG", "Angle of each turn of six.")] = 360.0,
    out: Out = OUT,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Calibrate an IMU in many positions."""
    from math import radians

    from insnav.session.bench import bench_gravity

    assert data.imu is not None
    parse.finite(height, "--height", largest=1e5)
    g, source = bench_gravity(gravity, lat, height)

    def opened(reading: Reading[ImuData]) -> None:
        say_reading(reading.facts)
        note(f"gravity {g:.5f} m/s^2, {source}")

    how: dict[str, Any] = {"files": data.imu, **{key: data.inputs.get(key) for key in READING}}
    how |= {"counts": counts, "six": method == "six", "gravity": g, "gravity_source": source}
    how |= {"sections": sections, "turn": radians(turn), "opened": opened}
    _calibrate("poses", how | {"out": out, "force": force, "as_json": as_json})


@_command("rotor", "gravity")
def rotor(
    fall: Annotated[Path, argument("FALL", "Heights and times of fall.")],
    precession: Annotated[Path, argument("PRECESSION", "Periods and rotor rates.")],
    fall_mass: Annotated[float, option(METHOD, "KG", "Mass of the falling weight.")],
    radius: Annotated[float, option(METHOD, "M", "Radius the cord is wound on.")],
    arm: Annotated[float, option(METHOD, "M", "Distance of the weight from the support.")],
    mass: Annotated[float, option(METHOD, "KG", "Mass of the weight on the arm. [column mass_kg]")] = 0.0,
    **how: Any,
) -> None:
    """Measure a rotor."""
    how |= {"fall_mass": fall_mass, "radius": radius, "arm": arm, "mass": mass}
    _calibrate("rotor", {"files": [fall, precession], **how})


def _calibrate(method: str, how: dict[str, Any]) -> None:
    """Calibrate, write the folder with calibration file and report, and print the result.

    `how`: ``files``, options of `insnav.session.bench.calibrate`, and result options.
    """
    files, out, as_json = (how.pop(name) for name in ("files", "out", "as_json"))
    if isinstance(how.get("columns"), str):
        how["columns"] = parse.columns(how["columns"], "--columns")
    with working(out, how.pop("force")) as (folder, stage):
        stage("loading")
        from insnav.session.bench import calibrate

        outcome = calibrate(method, files, stage=stage, **how)
        where = write_result(outcome, folder, stage, figures="png")
    if as_json:
        for line in outcome.page().warnings:
            note(f"warning: {line}")
    result_page(where, outcome.page(), out, as_json=as_json, more=("calibration.toml",))
