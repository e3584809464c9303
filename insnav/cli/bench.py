"""Commands on IMUs and their bench records: acceptance, allan, calibrate, drift, imus, platform, tune."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer

from insnav.cli import options as common
from insnav.cli.console import note, note_warnings, result, result_page, summary_text, working, write_result
from insnav.cli.data_options import READING, Data, say_reading, takes_data
from insnav.cli.help import GroupedCommand, LightGroup, help_of
from insnav.cli.options import IMU, METHOD, RESULT, START, Columns, Force, Json, Out, argument, flag, option
from insnav.exceptions import ConfigError
from insnav.steps.inputs import Inputs
from insnav.units import DEG, DEG_PER_H, UG

if TYPE_CHECKING:
    from insnav.input.readers.reading import Reading
    from insnav.result import Result
    from insnav.types import ImuData


def acceptance(
    rates: Annotated[
        list[Path] | None, option(common.FILES, "FILE", "Rate table of the gyros; may be given again.")
    ] = None,
    positions: Annotated[
        list[Path] | None, option(common.FILES, "FILE", "Positions of the accelerometers in gravity; again too.")
    ] = None,
    static: Annotated[Path | None, option(common.FILES, "FILE", "Record at rest.")] = None,
    powerups: Annotated[
        list[Path] | None, option(common.FILES, "FILE", "Outputs at +w and -w after each power-up.")
    ] = None,
    columns: Columns = None,
    lengths: Annotated[str, option(METHOD, "S,S,…", "Averaging times of the bias stability, s.")] = "1,10,100",
    spike_limit: common.SpikeLimit = None,
    out: Out = Path("acceptance"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compute acceptance figures."""
    times = common.positive_numbers(lengths, "--lengths", "1,10,100")
    named = common.columns(columns, "--columns")
    with working(out, force) as (folder, stage):
        stage("reading")
        from insnav.session.bench import acceptance as accepted

        steps = [*(rates or ()), *(positions or ())]
        outcome = accepted(steps, static, powerups or (), lengths=times, columns=named, spike_limit=spike_limit)
        note_warnings(outcome)
        where = write_result(outcome, folder, stage, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json)


@takes_data(files={}, only=("calibration", *READING, "topic"))
def allan(
    data: Data,
    static: Annotated[str | None, option(START, "FROM:TO", "Part to use, s. [all]")] = None,
    column: Annotated[str | None, option(IMU, "HEADER", "Analyse this column alone, in its own unit.")] = None,
    rate: Annotated[float | None, option(IMU, "HZ", "Sampling rate of a file without times.", min=1e-6)] = None,
    taus: Annotated[str, option(START, "S,S,…", "Averaging times, s; log (about 90), octave.")] = "log",
    workers: Annotated[int | None, option(RESULT, "N", "Threads. [processors]", min=1)] = None,
    out: Out = Path("allan"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Analyse the noise of a static record."""
    wanted: Any = taus if taus in ("log", "octave") else common.positive_numbers(taus, "--taus", "0.1,1,10")
    span = common.span(static, "--static") if static else None
    with working(out, force) as (folder, stage):
        given = replace(data, inputs=cast(Inputs, {**data.inputs, "rate": rate}))
        source: Any = data.imu if column else given.read_imu(stage, "noise")
        stage("noise")
        from insnav.session.bench import allan as analysed

        outcome = analysed(
            source,
            column=column,
            rate=rate if column else None,
            taus=wanted,
            static=span,
            workers=workers,
            progress=lambda fraction: stage("noise", fraction),
        )
        note_warnings(outcome)
        outcome, where = data.save(outcome, folder, stage, figures="png")
    files = ("allan.csv",) if column else ("imu.toml", "imu.yaml", "allan.csv")
    result_page(where, outcome.page(), out, as_json=as_json, more=files)


OUT = Path("calibration")
Gravity = Annotated[float, option(METHOD, "M/S2", "Local gravity.")]
Name = Annotated[str, option(RESULT, "TEXT", "Name of the calibrated sensor.")]
Add = Annotated[
    Path | None, option(RESULT, "FILE", "A calibration.toml with the other triad, to copy into the new file.")
]
_KEYWORD = inspect.Parameter.KEYWORD_ONLY
_KINDS: tuple[tuple[str, Any, Any], ...] = (
    *(("columns", Columns, None), ("gravity", Gravity, 9.80665), ("spike_limit", common.SpikeLimit, None)),
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
    _calibrate("gyro", {"files": files, "keep": common.span(keep, "--range") if keep else None, **how})


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
    pieces = common.named_numbers(intercepts, "--intercept", "-0.01")
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
    common.finite(height, "--height", largest=1e5)
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
        how["columns"] = common.columns(how["columns"], "--columns")
    with working(out, how.pop("force")) as (folder, stage):
        stage("loading")
        from insnav.session.bench import calibrate

        outcome = calibrate(method, files, stage=stage, **how)
        where = write_result(outcome, folder, stage, figures="png")
    if as_json:
        for line in outcome.page().warnings:
            note(f"warning: {line}")
    result_page(where, outcome.page(), out, as_json=as_json, more=("calibration.toml",))


def drift(
    file: Annotated[Path, argument("FILE", "Record of the bench.")],
    columns: Columns = None,
    out: Out = Path("drift"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Study the drift of gyros."""
    with working(out, force) as (folder, stage):
        stage("reading")
        from insnav.session.bench import drift as studied

        outcome = studied(file, columns=common.columns(columns, "--columns"))
        note_warnings(outcome)
        where = write_result(outcome, folder, stage, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json, more=("calibration.toml", "rates.csv"))


def imus(
    name: Annotated[str | None, argument("PART", "A part, in any spelling. [all]", IMU)] = None,
    as_json: Annotated[bool, flag(RESULT, "--json", "Print JSON.")] = False,
) -> None:
    """List real IMUs, or show one."""
    from insnav.report.save import facts_of
    from insnav.session.bench import imus as listed

    found = listed(name)
    result(json.dumps(facts_of(found), indent=2, ensure_ascii=False) if as_json else summary_text(found))


ERRORS = "Errors of the platform"


def platform(
    force_file: Annotated[
        Path | None,
        argument("FORCE_FILE", "Specific force: a data file of any supported format, or - for standard input."),
    ] = None,
    columns: Annotated[
        str | None, option(common.FILES, "NAME=HEADER,…", "Names of unrecognised columns: f_east=Fe,time_s=t.")
    ] = None,
    axes: Annotated[
        Literal["ENU", "NED"] | None,
        option(common.FILES, "AXES", "Axes of columns x, y, z: ENU or NED. [by the names]"),
    ] = None,
    sample_rate: Annotated[
        float | None, option(common.FILES, "HZ", "Samples per second of a file without times.")
    ] = None,
    height_input: Annotated[
        Path | None, option(common.FILES, "FILE", "Heights to damp the vertical channel with: time_s, height_m.")
    ] = None,
    ref: Annotated[Path | None, option(common.FILES, "FILE", "Reference to evaluate the integrators against.")] = None,
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
    rate: common.Rate = "10",
    out: Out = Path("platform"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Integrate the specific force on a platform."""
    configuration = common.configuration(locals())

    if demo:
        defaults = inspect.signature(platform).parameters
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
    tilt = DEG * common.numbers(misalignment, "--misalignment", 3, "0.01,0,0.1")
    drift = DEG_PER_H * common.numbers(gyro_drift, "--gyro-drift", 3, "0.01,0.01,0.01")
    bias = UG * common.numbers(accel_bias, "--accel-bias", 3, "50,50,0")
    interval = common.interval(rate)
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
            how |= {"columns": common.columns(columns, "--columns"), "sample_rate": sample_rate, "opened": say_reading}
            outcome = replace(platform_run.platform(force_file, *start, **how), options=configuration)
        where = write_result(outcome, folder, stage, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json, more=("solution.csv", "torquing.csv"))


@takes_data(
    None,
    files={"gps": False},
    only=("imu_model", "axes", "units", "lever_arm", "lever_arm_sd", "gps_delay", "gps_height"),
)
def tune(
    data: Data,
    drives: Annotated[list[Path], argument("DRIVE", "Folders of recordings, or one IMU file.")],
    out: Out = Path("tune"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Estimate the noise of an IMU."""
    with working(out, force) as (folder, stage):
        stage("reading")
        from insnav.fleet.tuning import tune as tuned
        from insnav.messages import sentence

        inputs: Any = {"imu" if key == "imu_model" else key: value for key, value in data.inputs.items()}
        outcome = tuned(*drives, gps=data.gps, **inputs)
        note(f"prior: {outcome.found.prior.name}: {sentence(outcome.found.prior_chosen)}")
        outcome, where = data.save(outcome, folder, stage, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json, more=("imu.toml",))
