"""Location of the included profiles and sample drive."""

from __future__ import annotations

from pathlib import Path

from insnav.exceptions import InputError

FOLDER = "trajectories"
SAMPLE = ("imu.csv.gz", "gps.csv", "ref.csv")


def library(folder: Path | None = None) -> list[Path]:
    """List motion profiles of the library, or of another folder, alphabetically; empty without a library."""
    found = _folder() if folder is None else folder
    return sorted(path for path in found.glob("*.toml") if path.stem != "corpus")


def sample_drive() -> list[Path]:
    """Return the IMU, GPS and reference file of the sample drive.

    Raises: InputError: they are not present.
    """
    files = [_folder() / "sample" / name for name in SAMPLE]
    absent = [str(file) for file in files if not file.is_file()]
    if absent:
        raise InputError("install.no_sample_drive", where=", ".join(absent))
    return files


def _folder() -> Path:
    """Return the library folder: next to the package in development, inside it after installation."""
    package = Path(__file__).parent
    beside = package.parent / FOLDER
    return beside if any(beside.glob("*.toml")) else package / FOLDER
