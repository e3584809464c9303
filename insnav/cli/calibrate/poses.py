"""``insnav calibrate poses``: an IMU calibrated by hand, without any table."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.console import Stages, note, result_sheet

SHORT_HELP = "IMU calibrated by hand: many poses, or six positions and three turns."
HELP = """IMU calibrated by hand, without any table: many poses, or six positions and three turns.

Poses: put the IMU down in 12 to 40 different poses for 3 s each, turning it by about 90 degrees between them; poses are
found by themselves. Six: every axis up and down at rest, then a full turn about each axis while it points up.
Gravity must be known: by --gravity or --lat (and --height).

\b
Examples:
  insnav calibrate poses imu.csv --lat 48.1 --height 520
  insnav calibrate poses counts.csv --counts --gravity 9.81744 --out mti
  insnav calibrate poses imu.csv --method six --lat 49.6 --sections sections.json
  insnav run drive.csv --gps gps.csv --calibration calibration/calibration.toml
"""

METHOD = "Method"


class Method(StrEnum):
    """How the record was made."""

    poses = "poses"
    six = "six"


def poses(
    imu_file: opt.ImuFile,
    method: Annotated[
        Method,
        typer.Option(metavar="HOW", help="How it was recorded: poses, or six (Ferraris).", rich_help_panel=METHOD),
    ] = Method.poses,
    counts: Annotated[
        bool,
        typer.Option("--counts", help="The file holds raw counts or volts, not SI units.", rich_help_panel=METHOD),
    ] = False,
    gravity: Annotated[
        float | None, typer.Option(metavar="M_S2", help="Gravity at the bench, m/s^2.", rich_help_panel=METHOD)
    ] = None,
    lat: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Latitude, if gravity is not given.", rich_help_panel=METHOD),
    ] = None,
    height: Annotated[
        float, typer.Option(metavar="M", help="Height above the ellipsoid.", rich_help_panel=METHOD)
    ] = 0.0,
    sections: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="First and last sample of x_p (x up), x_a (x down), …, x_rot, … for six (JSON or TOML). [found]",
            rich_help_panel=METHOD,
        ),
    ] = None,
    turn: Annotated[
        float, typer.Option(metavar="DEG", help="Angle of each turn of six.", rich_help_panel=METHOD)
    ] = 360.0,
    imu_axes: opt.Axes = None,
    imu_units: opt.Units = None,
    columns: opt.Columns = None,
    imu_sampling: opt.SamplingOption = None,
    imu_stamp: opt.StampOption = None,
    out: opt.Out = Path("calibration"),
    force: opt.Force = False,
    as_json: opt.Json = False,
) -> None:
    """Calibrate an IMU by hand."""
    from dataclasses import replace

    from insnav.cli import inputs
    from insnav.exceptions import ConfigError
    from insnav.output.folder import RunFolder
    from insnav.units import DEG

    g, source = _gravity(gravity, lat, height)
    if method is Method.poses and sections is not None:
        raise ConfigError("sections belong to six positions", where="--sections", fix="add --method six")
    if counts and (imu_units or imu_sampling or imu_stamp):
        raise ConfigError("raw counts have no units", where="--counts", fix="leave out --imu-units, --imu-sampling …")
    if not 90.0 <= turn <= 36000.0:
        raise ConfigError(f"{turn:g} degrees is not a turn to calibrate by", where="--turn", fix="such as 360")
    spans = None if sections is None else _sections(sections)
    with RunFolder(out, force=force) as folder, Stages() as stage:
        stage("reading")
        from insnav.imu import calibration_to_toml
        from insnav.input.interpret.axes import axes_matrix
        from insnav.input.readers.raw_counts import read_counts
        from insnav.lab.multi_position.many_positions import calibrate_poses
        from insnav.lab.multi_position.method import hand_errors, hand_uncertainty
        from insnav.lab.multi_position.six_positions import calibrate_six_positions
        from insnav.lab.navigation_impact import minute_effect
        from insnav.plain_text import plain_text
        from insnav.report.calibration.multi_position import poses_facts, poses_sheet, poses_warnings
        from insnav.report.sheet import write_sheet

        if counts:
            with inputs.named_options():
                reading = read_counts(imu_file, axes=imu_axes, columns=parse.columns(columns, "--columns"))
        else:
            # a bench record shows any side up: axes are not judged by it
            reading = inputs.read_samples(
                imu_file, imu_axes or "FRD", columns, imu_units, imu_sampling, imu_stamp, None
            )
        inputs.say_reading(reading.facts)
        note(f"gravity {g:.5f} m/s^2, {source}")
        stage("calibrating")
        data = reading.data
        found = (
            calibrate_poses(data, g, counts=counts)
            if method is Method.poses
            else calibrate_six_positions(data, g, spans, turn=turn * DEG, counts=counts)
        )
        stage("navigating")
        calibrated = hand_uncertainty(found)
        effects = minute_effect(calibrated)
        stage("writing")
        warnings = poses_warnings(found, data)
        temperature = None if data.temperature is None else float(data.temperature.mean())
        configuration = {"method": method.value, "counts": counts, "gravity_m_s2": g, "gravity": source}
        facts = poses_facts(found, effects, reading.facts.as_dict(), configuration, warnings)
        sheet = poses_sheet(found, calibrated, effects, reading.facts.path, warnings)
        errors = hand_errors(
            found,
            axes=axes_matrix(imu_axes or "FRD"),
            name=plain_text(Path(reading.facts.path).stem),
            temperature=temperature,
        )
        texts = {"calibration.toml": calibration_to_toml(errors)}
        where = write_sheet(folder, sheet, facts, texts)
    shown = replace(sheet, tables=sheet.tables[:-1])  # the last lists every pose
    result_sheet(where, shown, out, as_json=as_json, more=texts)


def _gravity(gravity: float | None, lat: float | None, height: float) -> tuple[float, str]:
    """Gravity and where it is from; never assumed."""
    import numpy as np

    from insnav.earth import gravity_n
    from insnav.exceptions import ConfigError

    if gravity is not None:
        if lat is not None:
            raise ConfigError("gravity is given twice", where="--gravity, --lat", fix="leave one out")
        if not 9.7 <= gravity <= 9.9:
            raise ConfigError(
                f"{gravity:g} m/s^2 is not gravity on the Earth", where="--gravity", fix="between 9.76 and 9.84"
            )
        return gravity, "as given"
    if lat is None:
        raise ConfigError(
            "gravity is not known",
            why="it is the measure of the accelerometers, and varies by 0.5 % over the Earth",
            fix="give --lat (and --height), or --gravity",
        )
    if not -90.0 <= lat <= 90.0:
        raise ConfigError(f"{lat:g} is not a latitude", where="--lat", fix="give degrees, north positive")
    parse.finite(height, "--height", largest=1e5)
    return float(np.linalg.norm(gravity_n(np.deg2rad(lat), height))), f"normal gravity at {lat:g} deg, {height:g} m"


def _sections(path: Path) -> dict[str, tuple[int, int]]:
    """Sections of a record from a JSON or TOML file: ``{"x_p": {"start": 0, "end": 500}, …}`` or ``[0, 500]``."""
    import json

    from insnav.config_file import read_toml
    from insnav.exceptions import ConfigError

    if path.suffix.lower() == ".toml":
        content = read_toml(path)
    else:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise ConfigError("cannot read the sections", where=str(path), why=str(error)) from None
    spans, wrong = {}, []
    for name, value in content.items() if isinstance(content, dict) else ():
        pair = [value.get("start"), value.get("end")] if isinstance(value, dict) else value
        if isinstance(pair, list) and len(pair) == 2 and all(type(item) is int for item in pair):
            spans[str(name)] = (pair[0], pair[1])
        else:
            wrong.append(str(name))
    if wrong or not spans:
        raise ConfigError(
            "the sections cannot be understood",
            where=str(path),
            why=f"no first and last sample of {', '.join(wrong) or 'anything'}",
            fix='write "x_p": {"start": 540, "end": 1271}',
        )
    return spans
