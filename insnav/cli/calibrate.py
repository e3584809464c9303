"""``insnav calibrate``: from the bench to a calibration file, one command a method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from insnav.cli import parse
from insnav.cli.console import note, result_page, working
from insnav.cli.data_options import READING, Data, say_reading, takes_data
from insnav.cli.help import GroupedCommand
from insnav.cli.options import METHOD, RESULT, Columns, Force, Json, Out, SpikeLimit, argument, flag, option

if TYPE_CHECKING:
    from insnav.input.readers.reading import Reading
    from insnav.types import ImuData

SHORT_HELP = "Bench data to a calibration file: gyro, accel, imu, nine, poses, rotor."
HELP = """Bench data to a calibration file, with the uncertainty of everything in it.

Every method writes a folder with report.html and, but for rotor, calibration.toml for insnav run --calibration.
"""
GYRO = """Zero and scale factor of gyros from a rate table.

A file holds rate_deg_s and output_v (or output_lsb, output_deg_s): one row a dwell, or all its samples in successive
rows, which are cleaned of spikes. Give the files of x, y, z, or one that stands for all three.
Rates at which the output has left the straight line are found and left out.

\b
Examples:
  insnav calibrate gyro rate_table.csv
  insnav calibrate gyro rate_table.csv --range -90:80
  insnav calibrate gyro x.csv y.csv z.csv --out gyros
  insnav calibrate gyro x.csv y.csv z.csv --add accels/calibration.toml --out imu7
"""
ACCEL = """Bias, scale factor, second order and cross-coupling of accelerometers from a tumble test.

A file holds angle_deg, the angle of the input axis above the horizontal, evenly spaced over the circle, and output_v
(or output_lsb, output_g, output_m_s2): one row a position, or all its samples in successive rows. Give the files of
x, y, z, or one that stands for all three.

\b
Examples:
  insnav calibrate accel tumble.csv
  insnav calibrate accel x.csv y.csv z.csv --gravity 9.7957
  insnav calibrate accel tumble.csv --add gyros/calibration.toml --out imu7
"""
IMU = """Full matrix and bias of three gyros from rate sweeps about three axes, then a piecewise-linear compensation.

Three files, the table turned about x, about y, about z, each with rate_deg_s and the outputs of all three gyros,
gyro_x_deg_s, gyro_y_deg_s, gyro_z_deg_s (or gyro_x_v, gyro_x_lsb …); or one file with rate_x_deg_s, rate_y_deg_s,
rate_z_deg_s. One row a dwell, or all its samples in successive rows, for example -300 to 300 deg/s in steps of 10.
Saturated rates are found and left out, and the borders of the pieces are found. Where a piece still misses what is
required, --intercept moves it, its neighbours stay, and the report has the error before and after.

\b
Examples:
  insnav calibrate imu about_x.csv about_y.csv about_z.csv
  insnav calibrate imu sweeps.csv --add accels/calibration.toml --out imu7
  insnav calibrate imu sweeps.csv --intercept x2=-0.012 --out adjusted
  insnav run drive.csv --gps gps.csv --calibration calibration/calibration.toml
"""
NINE = """Accelerometers, and the misalignment of gyros without any rotation, from nine positions of a position table.

For three modules, each one gyro and the two accelerometers across its axis. The file holds roll_deg, pitch_deg and
x_ay_g, x_az_g, y_az_g, y_ax_g, z_ax_g, z_ay_g (module, then axis; also in m/s2, mg, or the outputs in V, mV, LSB,
which give each a bias voltage and a scale factor): one row a position, or all its samples in successive rows. Gyros
recorded at rest, gyro_x_deg_s or gyro_x_v …, give their bias and g-sensitivity. Positions: level; ± about x; ± about
y; the four combinations; angles of 20 to 75 deg. Upright ones (180, ± 90 deg) may be added: biases then come from the
two extremes of each axis.

\b
Examples:
  insnav calibrate nine positions.csv
  insnav calibrate nine positions.csv --gravity 9.7957 --out imu7
"""
POSES = """Multi-position calibration without a table: many poses, or six positions and three turns.

Poses: put the IMU down in 12 to 40 different poses for 3 s each, turning it by about 90 degrees between them; poses are
found automatically. Six: every axis up and down at rest, then a full turn about each axis while it points up.
Gravity must be known: by --gravity or --lat (and --height).

\b
Examples:
  insnav calibrate poses imu.csv --lat 48.1 --height 520
  insnav calibrate poses counts.csv --counts --gravity 9.81744 --out mti
  insnav calibrate poses imu.csv --method six --lat 49.6 --sections sections.json
  insnav run drive.csv --gps gps.csv --calibration calibration/calibration.toml
"""
ROTOR = """Moment of inertia of a gyroscope's rotor two ways, and whether they agree.

FALL holds height_m and fall_time_s of a weight that spins the rotor up by a cord; PRECESSION holds
precession_period_s and rotor_rate_rad_s (or rotor_rate_rpm) under a weight on an arm, and mass_kg where there were
several weights: one regression over spin and torque.

\b
Examples:
  insnav calibrate rotor fall.csv precession.csv --fall-mass 0.06 --radius 0.0225 --mass 0.05 --arm 0.25
"""

OUT = Path("calibration")
Gravity = Annotated[float, option(METHOD, "M/S2", "Local gravity.")]
Name = Annotated[str, option(RESULT, "TEXT", "What was calibrated.")]
Add = Annotated[
    Path | None, option(RESULT, "FILE", "A calibration.toml whose other triad is carried over into the new file.")
]

app = typer.Typer(
    name="calibrate",
    help=HELP,
    short_help=SHORT_HELP,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _command(text: str, short: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a command of a method, with its help."""
    return app.command(cls=GroupedCommand, help=text, short_help=short)


@_command(GYRO, "Zero and scale factor of gyros from a rate table.")
def gyro(
    files: Annotated[list[Path], argument("FILE", "Rate table of x, y, z, or one.")],
    columns: Columns = None,
    keep: Annotated[
        str | None, option(METHOD, "FROM:TO", "Rates to use, deg/s. [all that are linear]", "--range")
    ] = None,
    spike_limit: SpikeLimit = None,
    add: Add = None,
    name: Name = "",
    out: Out = OUT,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Calibrate gyros on a rate table."""
    span = parse.span(keep, "--range") if keep else None
    how = {"columns": _named(columns), "keep": span, "spike_limit": spike_limit, "add": add, "name": name}
    _calibrate("gyro", files, how, out, force, as_json)


@_command(ACCEL, "Bias, scale factor, second order and cross-coupling from a tumble test.")
def accel(
    files: Annotated[list[Path], argument("FILE", "Tumble test of x, y, z, or one.")],
    columns: Columns = None,
    gravity: Gravity = 9.80665,
    spike_limit: SpikeLimit = None,
    add: Add = None,
    name: Name = "",
    out: Out = OUT,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Calibrate accelerometers by tumbling."""
    how = {"columns": _named(columns), "gravity": gravity, "spike_limit": spike_limit, "add": add, "name": name}
    _calibrate("accel", files, how, out, force, as_json)


@_command(IMU, "Gyro matrix and bias from rate sweeps, then compensation of what is left over the rate.")
def imu(
    files: Annotated[list[Path], argument("FILE", "Sweeps about x, y, z, or one.")],
    columns: Columns = None,
    spike_limit: SpikeLimit = None,
    intercept: Annotated[
        str | None,
        option(METHOD, "PIECE=DEG/S,…", "Intercepts b' set by hand; x2 is the second piece of gyro x."),
    ] = None,
    add: Add = None,
    name: Name = "",
    out: Out = OUT,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Calibrate three gyros by sweeps."""
    intercepts = parse.named_numbers(intercept, "--intercept", "-0.01")
    how = {"columns": _named(columns), "spike_limit": spike_limit, "add": add, "name": name, "intercepts": intercepts}
    _calibrate("imu", files, how, out, force, as_json)


@_command(NINE, "Three dual-axis modules in nine positions, gyro misalignment without rotation.")
def nine(
    file: Annotated[Path, argument("FILE", "Table of positions.")],
    columns: Columns = None,
    gravity: Gravity = 9.80665,
    name: Name = "",
    out: Out = OUT,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Calibrate dual-axis modules."""
    how = {"columns": _named(columns), "gravity": gravity, "name": name}
    _calibrate("nine", [file], how, out, force, as_json)


@_command(POSES, "Multi-position calibration: many poses, or six positions and three turns.")
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

    how: dict[str, Any] = {key: data.inputs.get(key) for key in READING}
    how |= {"counts": counts, "six": method == "six", "gravity": g, "gravity_source": source}
    how |= {"sections": sections, "turn": radians(turn)}
    _calibrate("poses", [data.imu], how, out, force, as_json, opened)


@_command(ROTOR, "Moment of inertia of a rotor by a falling weight and by precession.")
def rotor(
    fall: Annotated[Path, argument("FALL", "Heights and times of fall.")],
    precession: Annotated[Path, argument("PRECESSION", "Periods and rotor rates.")],
    fall_mass: Annotated[float, option(METHOD, "KG", "Mass of the falling weight.")],
    radius: Annotated[float, option(METHOD, "M", "Radius the cord is wound on.")],
    arm: Annotated[float, option(METHOD, "M", "Distance of the weight from the support.")],
    mass: Annotated[float, option(METHOD, "KG", "Mass of the weight on the arm. [column mass_kg]")] = 0.0,
    gravity: Gravity = 9.80665,
    out: Out = OUT,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Measure a rotor."""
    how = {"fall_mass": fall_mass, "mass": mass, "radius": radius, "arm": arm, "gravity": gravity}
    _calibrate("rotor", [fall, precession], how, out, force, as_json)


def _named(columns: str | None) -> dict[str, str] | None:
    return parse.columns(columns, "--columns")


def _calibrate(
    method: str,
    files: Sequence[Path],
    how: dict[str, Any],
    out: Path,
    force: bool,
    as_json: bool,
    opened: Callable[[Any], None] | None = None,
) -> None:
    """Calibrate, write the folder with calibration file and report, and print the result.

    `how`: options of `insnav.session.bench.calibrate`.
    """
    with working(out, force) as (folder, stage):
        stage("loading")
        from insnav.imu import calibration_to_toml
        from insnav.report.calibration.page import calibration_metadata, calibration_page
        from insnav.report.save import write_page
        from insnav.session.bench import calibrate

        found = calibrate(method, files, stage=stage, opened=opened, **how)
        stage("writing")
        page = calibration_page(found)
        texts = {} if found.errors is None else {"calibration.toml": calibration_to_toml(found.errors)}
        where = write_page(folder, page, calibration_metadata(found), texts)
    if as_json:
        for line in page.warnings:
            note(f"warning: {line}")
    result_page(where, page, out, as_json=as_json, more=texts)
