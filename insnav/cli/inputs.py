"""From the options to data and models, and the words about them for the log."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from insnav.cli import parse
from insnav.cli.console import note, note_more
from insnav.exceptions import ConfigError, InsnavError

if TYPE_CHECKING:
    from insnav.cli.options import SamplingChoice, StampChoice
    from insnav.imu.specification import ImuSpec
    from insnav.input import Reading
    from insnav.input.readers.reading import ReadingFacts
    from insnav.types import GpsData, ImuData, Trajectory

SHORTEST_REST = 5.0  # shorter ones do not show the noise of an IMU [s]
_OPTION = re.compile(r"^(columns|imu-[a-z]+)\b")
_NOTHING_NEW = re.compile(r"(time|positions) in \w+|.*: as stated")


@contextmanager
def named_options(columns: str = "--columns") -> Iterator[None]:
    """Let errors of the readers name the options as the user knows them.

    Parameters
    ----------
    columns : str
        The option that names columns of this file.
    """
    try:
        yield
    except InsnavError as error:
        error.where = _OPTION.sub(r"--\1", error.where).replace("--columns", columns)
        error.fix = error.fix.replace("--columns", columns)
        raise


def read_samples(
    path: Path,
    axes: str | None,
    columns: str | None,
    units: str | None,
    sampling: SamplingChoice | None,
    stamp: StampChoice | None,
    calibration: Path | None,
) -> Reading[ImuData]:
    """Read the IMU file with the options every command shares, and take known errors off.

    Volts and counts become rates and specific forces by the lines of the calibration.
    """
    from insnav.imu import correct, load_calibration
    from insnav.input import read_imu

    known = None if calibration is None else load_calibration(calibration)
    scales = {} if known is None else {"gyro": known.gyro_raw, "accel": known.accel_raw}
    with named_options():
        reading = read_imu(
            path,
            axes=axes,
            columns=parse.columns(columns, "--columns"),
            units=units,
            sampling=sampling.value if sampling else None,
            stamp=stamp.value if stamp else None,
            raw_scales={triad: scale for triad, scale in scales.items() if scale is not None},
        )
    return reading if known is None else replace(reading, data=correct(reading.data, known))


def read_fixes(path: Path, columns: str | None, height: str | None) -> Reading[GpsData]:
    """Read the GPS file."""
    from insnav.input import read_gps

    with named_options("--gps-columns"):
        return read_gps(
            path,
            columns=parse.columns(columns, "--gps-columns"),
            height=None if height is None else ("msl" if height == "msl" else "ellipsoidal"),
        )


def read_truth(path: Path, columns: str | None) -> Reading[Trajectory]:
    """Read the reference."""
    from insnav.input import read_reference

    with named_options("--ref-columns"):
        return read_reference(path, columns=parse.columns(columns, "--ref-columns"))


def one_standard_input(**files: Path | None) -> None:
    """Refuse to take two files from standard input, which can be read only once."""
    names = [f"--{name}" if name != "imu_file" else "IMU_FILE" for name, path in files.items() if str(path) == "-"]
    if len(names) > 1:
        raise ConfigError(
            "only one file can come from standard input", where=", ".join(names), fix="give the others by name"
        )


def say_reading(facts: ReadingFacts) -> None:
    """Log what was read and how it was understood, without what goes without saying."""
    head, *_ = facts.lines()
    note(head)
    renamed = _renamed(facts.columns)
    if renamed:
        note_more(f"columns: {renamed}; the others by their names")
    for text in facts.evidence:
        if not _NOTHING_NEW.fullmatch(text):
            note_more(text)


def _renamed(columns: Mapping[str, str]) -> str:
    """Columns whose header is not the quantity's own name, with or without its unit."""
    headers = {name: text.split(" [")[0] for name, text in columns.items()}
    return ", ".join(
        f"{name} = {columns[name]}"
        for name, header in headers.items()
        if name != header and not name.startswith(f"{header}_")
    )


def chosen_imu(choice: str | None) -> tuple[ImuSpec, str] | None:
    """IMU model as chosen and what to say about it; None if it is left to the data."""
    if choice is None:
        return None
    from insnav.imu import load_imu

    spec = load_imu(choice)
    absent = f"; not given, taken as zero: {', '.join(spec.absent)}" if spec.absent else ""
    return spec, f"as told by --imu {choice}{absent}"


def imu_from_rest(imu: ImuData, rest: tuple[float, float] | None) -> tuple[ImuSpec, str]:
    """IMU model from the noise of the static part, and what to say about it."""
    from insnav.imu import identify, load_imu

    if rest is None or rest[1] - rest[0] < SHORTEST_REST:
        reason = f"no static part of {SHORTEST_REST:g} s shows the noise"
        return load_imu("consumer"), f"assumed, as {reason}; choose another with --imu"
    spec, sentence = identify(imu, *rest)
    return spec, sentence.rstrip(".")
