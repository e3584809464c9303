"""``insnav platform``: the north-pointing gimballed platform."""

from __future__ import annotations

from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from insnav.cli import parse
from insnav.cli.console import note, result_page, working
from insnav.cli.data_options import say_reading
from insnav.cli.options import FILES, RESULT, START, Force, Json, Out, Rate, argument, flag, option
from insnav.exceptions import ConfigError
from insnav.units import DEG, DEG_PER_H, UG

if TYPE_CHECKING:
    from insnav.gimbal import PlatformErrors
    from insnav.report.page import Page

ERRORS = "Errors of the platform"


def platform(
    force_file: Annotated[
        Path | None,
        argument("FORCE_FILE", "Specific force: a data file of any supported format, or - for standard input."),
    ] = None,
    columns: Annotated[
        str | None, option(FILES, "NAME=HEADER,…", "Headers that are not understood by themselves: f_east=Fe,time_s=t.")
    ] = None,
    axes: Annotated[
        Literal["ENU", "NED"] | None, option(FILES, "AXES", "What columns x, y, z are: ENU or NED. [by the names]")
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
    demo: Annotated[bool, flag(RESULT, "--demo", "Show what is known by closed form instead.")] = False,
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
            raise ConfigError(
                "the demonstration reads no file and has its own settings",
                where=", ".join(names),
                fix="leave these out, or --demo",
            )
        where, page = _demonstrate(out, force)
    else:
        if force_file is None or lat is None or lon is None:
            missing = [
                name for name, value in (("FORCE_FILE", force_file), ("--lat", lat), ("--lon", lon)) if value is None
            ]
            raise ConfigError(f"missing: {', '.join(missing)}", fix="give them, or --demo; see insnav platform --help")
        errors = _errors(misalignment, gyro_drift, accel_bias)
        interval = parse.interval(rate)
        if (vertical == "damped") != (height_input is not None):
            raise ConfigError(
                "--vertical damped and --height-input go together", where="--vertical", fix="give both or neither"
            )
        with working(out, force) as (folder, stage):
            from insnav.session.platform_run import PlatformStart, integrate, read_platform

            start = PlatformStart(lat * DEG, lon * DEG, height, (v_north, v_east, -v_up + 0.0))
            stage("reading")
            record = read_platform(
                force_file,
                height=height_input,
                ref=ref,
                axes=axes,
                columns=parse.columns(columns, "--columns"),
                sample_rate=sample_rate,
            )
            for facts in record.facts.values():
                say_reading(facts)
            stage("navigating")
            runs = integrate(record, start, errors, vertical=vertical, gravity=gravity, interval=interval)
            stage("writing")
            from insnav.errors.platform_errors import PlatformStudy
            from insnav.output.data_files import write_table
            from insnav.output.kml import write_kml
            from insnav.output.solution_tables import write_events, write_run_table
            from insnav.report.platform.page import platform_page, torquing_columns
            from insnav.report.save import write_page

            reading, reference = record.force, record.reference
            name = Path(reading.facts.path).name
            study = PlatformStudy(
                integrator, runs, errors, reference.data if reference else None, name, reading.facts.evidence
            )
            readings = {key: each.as_dict() for key, each in record.facts.items()}
            page = platform_page(study)
            metadata = {"configuration": configuration, "input": readings}
            write_run_table(folder.directory, study.run.solution)
            write_table(folder.path("torquing.csv"), torquing_columns(study.run))
            write_events(folder.directory, reading.events)
            write_kml(folder.directory, study.run.solution, name)
            where = write_page(folder, page, metadata)
    result_page(where, page, out, as_json=as_json, more=() if demo else ("solution.csv", "torquing.csv"))


def _demonstrate(out: Path, force: bool) -> tuple[Path, Page]:
    """Write the demonstration."""
    with working(out, force) as (folder, stage):
        note("a day at rest, two hours of a holding pattern: some seconds")
        stage("navigating")
        from insnav.report.platform.demonstration import demonstration
        from insnav.report.save import write_page

        page = demonstration()
        stage("writing")
        return write_page(folder, page), page


def _errors(misalignment: str, gyro_drift: str, accel_bias: str) -> PlatformErrors:
    from insnav.gimbal import PlatformErrors

    return PlatformErrors(
        DEG * parse.numbers(misalignment, "--misalignment", 3, "0.01,0,0.1"),
        DEG_PER_H * parse.numbers(gyro_drift, "--gyro-drift", 3, "0.01,0.01,0.01"),
        UG * parse.numbers(accel_bias, "--accel-bias", 3, "50,50,0"),
    )
