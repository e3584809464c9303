"""``insnav platform``: north-pointing gimballed platform."""

from __future__ import annotations

from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from insnav.cli import parse
from insnav.cli.console import note, result_page, working, write_result
from insnav.cli.data_options import say_reading
from insnav.cli.options import FILES, RESULT, START, Force, Json, Out, Rate, argument, flag, option
from insnav.exceptions import ConfigError
from insnav.units import DEG, DEG_PER_H, UG

if TYPE_CHECKING:
    from insnav.result import Result

ERRORS = "Errors of the platform"


def platform(
    force_file: Annotated[
        Path | None,
        argument("FORCE_FILE", "Specific force: a data file of any supported format, or - for standard input."),
    ] = None,
    columns: Annotated[
        str | None, option(FILES, "NAME=HEADER,…", "Names of unrecognised columns: f_east=Fe,time_s=t.")
    ] = None,
    axes: Annotated[
        Literal["ENU", "NED"] | None, option(FILES, "AXES", "Axes of columns x, y, z: ENU or NED. [by the names]")
    ] = None,
    sample_rate: Annotated[float | None, option(FILES, "HZ", "Samples per second of a file without times.")] = None,
    height_input: Annotated[
        Path | None, option(FILES, "FILE", "Heights to damp the vertical channel with: time_s, height_m.")
    ] = None,
    ref: Annotated[Path | None, option(FILES, "FILE", "Reference to evaluate the integrators against.")] = None,
    lat: Annotated[float | None, option(START, "DEG", "Latitude, north positive.")] = None,
    lon: Annotated[float | None, option(START, "DEG", "Longitude, east positive.")] = None,
    height: Annotated[float, option(START, "M", "Height above the ellipsoid.")] = 0.0,
    v_east: Annotated[float, option(START, "M/S", "Velocity at the start.")] = 0.0,
    v_north: Annotated[float, option(START, "M/S", "Velocity at the start.")] = 0.0,
    v_up: Annotated[float, option(START, "M/S", "Velocity at the start.")] = 0.0,
    vertical: Annotated[
        Literal["off", "free", "damped"],
        option(START, "HOW", "Vertical channel: off, free, or damped by --height-input."),
    ] = "off",
    gravity: Annotated[
        float | None,
        option(
            START,
            "M/S2",
            "Gravity of this size everywhere, straight down, without a part to the north. [normal gravity]",
        ),
    ] = None,
    integrator: Annotated[
        Literal["forward", "backward", "mean", "fourth"],
        option(START, "NAME", "Whose solution is written: forward, backward, mean or fourth; all are compared."),
    ] = "fourth",
    misalignment: Annotated[str, option(ERRORS, "N,E,D", "Turn of its axes at the start, deg.")] = "0,0,0",
    gyro_drift: Annotated[str, option(ERRORS, "N,E,D", "Rate at which it turns away, deg/h.")] = "0,0,0",
    accel_bias: Annotated[str, option(ERRORS, "N,E,D", "Accelerometer biases, ug.")] = "0,0,0",
    demo: Annotated[bool, flag(RESULT, "--demo", "Show examples with closed forms instead.")] = False,
    rate: Rate = "10",
    out: Out = Path("platform"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Integrate the specific force on a platform."""
    configuration = parse.configuration(locals())

    if demo:
        defaults = signature(platform).parameters
        stray = [name for name, value in configuration.items() if name != "demo" and value != defaults[name].default]
        if stray:
            names = ("FORCE_FILE" if name == "force_file" else f"--{name.replace('_', '-')}" for name in stray)
            raise ConfigError("cli.demonstration_alone", where=", ".join(names))
    elif force_file is None or lat is None or lon is None:
        missing = [
            name for name, value in (("FORCE_FILE", force_file), ("--lat", lat), ("--lon", lon)) if value is None
        ]
        raise ConfigError("cli.missing", missing=tuple(missing))
    else:
        start = lat * DEG, lon * DEG, height, (v_north, v_east, -v_up + 0.0)
    tilt = DEG * parse.numbers(misalignment, "--misalignment", 3, "0.01,0,0.1")
    drift = DEG_PER_H * parse.numbers(gyro_drift, "--gyro-drift", 3, "0.01,0.01,0.01")
    bias = UG * parse.numbers(accel_bias, "--accel-bias", 3, "50,50,0")
    interval = parse.interval(rate)
    if (vertical == "damped") != (height_input is not None):
        raise ConfigError("cli.damped_needs_heights", where="--vertical")
    with working(out, force) as (folder, stage):
        from insnav.session import platform_run

        outcome: Result[Any]
        if demo:
            note("a day at rest, two hours of a holding pattern: some seconds")
            stage("navigating")
            outcome = platform_run.demonstrate()
        else:
            assert force_file is not None
            stage("navigating")
            errors = {"tilt": tilt, "drift": drift, "bias": bias}
            how: dict[str, Any] = {"errors": errors, "integrator": integrator, "vertical": vertical}
            how |= {"gravity": gravity, "interval": interval, "heights": height_input, "ref": ref, "axes": axes}
            how |= {"columns": parse.columns(columns, "--columns"), "sample_rate": sample_rate, "opened": say_reading}
            outcome = replace(platform_run.platform(force_file, *start, **how), options=configuration)
        where = write_result(outcome, folder, stage, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json, more=("solution.csv", "torquing.csv"))
