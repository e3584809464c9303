"""``insnav run``: navigate a recorded drive."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from insnav.cli import parse
from insnav.cli.console import note, progress

if TYPE_CHECKING:
    from insnav.imu.model import ImuSpec
    from insnav.io import Reading
    from insnav.types import ImuData

HELP = """Navigate a recorded drive: IMU and GPS in, a run folder with solution, figures and report out.

\b
Examples:
  insnav run drive.csv --gps gps.csv
  insnav run drive.csv --gps gps.csv --lever-arm 0.8,-0.3,-1.2 --imu automotive --ref ref.csv --out drive1
  insnav run imu.csv.gz --gps gps.csv --imu mems.toml --static 0:300 --rate full --format parquet
  insnav run imu.csv --gps gps.csv --imu-axes FLU --imu-units deg/s,g --columns time_s=stamp
  insnav run imu.csv --gps gps.csv --json --figures none --force | jq .accuracy
"""


class Figures(StrEnum):
    """File format of the figures."""

    png = "png"
    svg = "svg"
    none = "none"


class TableFormat(StrEnum):
    """File format of the tables."""

    csv = "csv"
    parquet = "parquet"


class Height(StrEnum):
    """What heights are measured from."""

    ellipsoidal = "ellipsoidal"
    msl = "msl"


class SamplingChoice(StrEnum):
    """What an IMU sample is."""

    instant = "instant"
    mean = "mean"
    increment = "increment"


class StampChoice(StrEnum):
    """Where in its interval a sample is stamped."""

    start = "start"
    mid = "mid"
    end = "end"


ImuFile = Annotated[Path, typer.Argument(metavar="IMU_FILE", help="IMU data: .csv, .csv.gz, .parquet, - for stdin.")]
ImuModel = Annotated[
    str | None,
    typer.Option("--imu", help="Preset (consumer, automotive, industrial, tactical, navigation) or imu.toml."),
]
Calibration = Annotated[Path | None, typer.Option(help="Known IMU errors, taken off the data first (TOML).")]
Axes = Annotated[str | None, typer.Option("--imu-axes", help="Where the sensor's x, y, z point, e.g. FLU. [FRD]")]
Units = Annotated[str | None, typer.Option("--imu-units", help="Units of gyro and accelerometer, e.g. deg/s,g.")]
Columns = Annotated[str | None, typer.Option(help="Columns by name, e.g. gyro_x=Gx,time_s=t.")]
SamplingOption = Annotated[
    SamplingChoice | None,
    typer.Option("--imu-sampling", help="What a sample is. [mean; increment if so named]"),
]
StampOption = Annotated[StampChoice | None, typer.Option("--imu-stamp", help="Where a sample is stamped. [end]")]
Static = Annotated[str | None, typer.Option(help="Static interval for the alignment, START:END in s. [found]")]
Heading = Annotated[float | None, typer.Option(help="Heading at the start in degrees, good to 2 deg. [found]")]
Out = Annotated[Path, typer.Option(help="Run folder to make.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an existing run folder.")]
Json = Annotated[bool, typer.Option("--json", help="Print the facts as JSON instead of the summary.")]


def run(
    imu_file: ImuFile,
    gps: Annotated[Path, typer.Option(help="GPS fixes.")],
    ref: Annotated[Path | None, typer.Option(help="Reference trajectory to judge the solution by.")] = None,
    ref_lever_arm: Annotated[
        str | None, typer.Option(help="Point of the reference seen from the IMU, body axes, m. [0,0,0]")
    ] = None,
    lever_arm: Annotated[
        str | None, typer.Option(help="Antenna seen from the IMU: forward,right,down in m. [0,0,0]")
    ] = None,
    imu: ImuModel = None,
    calibration: Calibration = None,
    imu_axes: Axes = None,
    imu_units: Units = None,
    columns: Columns = None,
    imu_sampling: SamplingOption = None,
    imu_stamp: StampOption = None,
    gps_height: Annotated[Height, typer.Option(help="What GPS heights are measured from.")] = Height.ellipsoidal,
    gps_delay: Annotated[
        float | None, typer.Option(help="How much older fixes are than their stamps, s. [estimated]")
    ] = None,
    static: Static = None,
    heading: Heading = None,
    initial: Annotated[Path | None, typer.Option(help="Initial state (JSON) instead of an alignment.")] = None,
    states: Annotated[int, typer.Option(help="21, or 15 without scale factor errors.")] = 21,
    rate: Annotated[str, typer.Option(help="Rows per second of the solution, or full.")] = "10",
    format: Annotated[TableFormat, typer.Option(help="Format of the tables.")] = TableFormat.csv,
    figures: Annotated[Figures, typer.Option(help="Format of the figures.")] = Figures.png,
    out: Out = Path("run"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Navigate a recorded drive."""
    import numpy as np

    from insnav.exceptions import ConfigError
    from insnav.io.folder import RunFolder

    if states not in (15, 21):
        raise ConfigError(f"{states} states are not to be had", where="--states", fix="use 21 or 15")
    interval = _interval(rate)
    lever_b = parse.vector(lever_arm, "--lever-arm") if lever_arm else np.zeros(3)
    ref_lever_b = parse.vector(ref_lever_arm, "--ref-lever-arm") if ref_lever_arm else None
    static_span = parse.span(static, "--static") if static else None
    start = parse.start(initial) if initial else None
    with RunFolder(out, force=force) as folder:
        from insnav.filter import FilterSettings
        from insnav.filter.recording import DELAY_SD, navigate_recording
        from insnav.io import check_overlap, read_gps, read_reference

        reading = read_samples(imu_file, imu_axes, columns, imu_units, imu_sampling, imu_stamp)
        fixes = read_gps(gps, height=gps_height.value)
        reference = read_reference(ref) if ref else None
        check_overlap(reading.data, fixes.data)
        for each in (reading, fixes, reference):
            for line in each.facts.lines() if each is not None and not as_json else ():
                note(line)
        samples = calibrated(reading.data, calibration)
        spec, said = imu_spec(imu, samples, static_span)
        note(said)
        settings = FilterSettings(
            lever_b=lever_b,
            delay=gps_delay or 0.0,
            delay_sd=DELAY_SD if gps_delay is None else 0.0,
            output_interval=interval,
        )
        _say_if_compiling()
        with progress("navigating") as report:
            done = navigate_recording(
                samples,
                fixes.data,
                spec,
                settings,
                states=states,
                start=start,
                static_span=static_span,
                heading=None if heading is None else float(np.deg2rad(heading)),
                progress=report,
            )
        from insnav.report.write import write_run

        facts, where = write_run(
            folder,
            done,
            readings={"imu": reading, "gps": fixes, "reference": reference},
            configuration=_configuration(locals()),
            spec=spec,
            imu_note=said,
            reference_lever_b=ref_lever_b,
            table_format=format.value,
            figure_format=None if figures is Figures.none else figures.value,
        )
    if as_json:
        print(json.dumps(facts, indent=1, ensure_ascii=False))
    else:
        from insnav.report.summary import summary_lines

        print("\n".join(summary_lines(facts, where)))


def _interval(rate: str) -> float:
    """Seconds between rows of the solution; 0 for every sample."""
    from insnav.exceptions import ConfigError

    if rate == "full":
        return 0.0
    try:
        value = float(rate)
    except ValueError:
        value = 0.0
    if not 0.01 <= value <= 10000.0:
        raise ConfigError(f"{rate!r} is not a rate", where="--rate", fix="write rows per second, or full")
    return 1.0 / value


def read_samples(
    path: Path,
    axes: str | None,
    columns: str | None,
    units: str | None,
    sampling: SamplingChoice | None,
    stamp: StampChoice | None,
) -> Reading[ImuData]:
    """Read the IMU file with the options every command shares."""
    from insnav.io import read_imu

    return read_imu(
        path,
        axes=axes,
        columns=parse.columns(columns),
        units=units,
        sampling=sampling.value if sampling else None,
        stamp=stamp.value if stamp else None,
    )


def calibrated(imu: ImuData, calibration: Path | None) -> ImuData:
    """Take known errors off the data."""
    if calibration is None:
        return imu
    from insnav.imu import correct, load_calibration

    return correct(imu, load_calibration(calibration))


def imu_spec(choice: str | None, imu: ImuData, static_span: tuple[float, float] | None) -> tuple[ImuSpec, str]:
    """IMU model as chosen, or from the noise of the static part; and what to say about it."""
    from insnav.imu import load_imu

    if choice is not None:
        spec = load_imu(choice)
        absent = f"; not given, taken as zero: {', '.join(spec.absent)}" if spec.absent else ""
        return spec, f"IMU model: {spec.name}{absent}"
    from insnav.alignment import find_rest
    from insnav.imu import identify
    from insnav.strapdown import intervals

    rest = static_span or find_rest(intervals(imu))
    if rest is None or rest[1] - rest[0] < 5.0:
        spec = load_imu("consumer")
        return (
            spec,
            "IMU model: consumer, as no static part of 5 s shows the noise; choose another with --imu",
        )
    spec, sentence = identify(imu, *rest)
    return spec, f"IMU model: {sentence}"


def _say_if_compiling() -> None:
    """The first run after an installation compiles the kernels; say why it takes longer."""
    from insnav.kernels import errorstate

    cache = Path(errorstate.__file__).with_name("__pycache__")
    if not any(cache.glob("errorstate.propagate-*.nbi")):
        note("first run on this machine: compiling the numerical kernels, about 15 s; later runs start at once")


def _configuration(options: dict[str, Any]) -> dict[str, Any]:
    """Options as the user gave them, for run.json."""
    names = [
        "imu_file",
        "gps",
        "ref",
        "ref_lever_arm",
        "lever_arm",
        "imu",
        "calibration",
        "imu_axes",
        "imu_units",
        "columns",
        "imu_sampling",
        "imu_stamp",
        "gps_height",
        "gps_delay",
        "static",
        "heading",
        "initial",
        "states",
        "rate",
        "format",
        "figures",
    ]
    return {name: str(value) if isinstance(value := options[name], Path | StrEnum) else value for name in names}
