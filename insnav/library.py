"""Location of the included profiles and sample drive."""

from __future__ import annotations

from pathlib import Path

from insnav.exceptions import InputError

FOLDER = "trajectories"
SAMPLE = ("imu.csv.gz", "gps.csv", "ref.csv")


def library(folder: Path | None = None) -> list[Path]:
    """List motion profiles of the library, or of another folder, alphabetically; empty without a library."""
    source = _folder() if folder is None else folder
    return sorted(path for path in source.glob("*.toml") if path.stem != "corpus")  # corpus.toml is no profile


def sample_drive() -> list[Path]:
    """Return the IMU, GPS and reference file of the sample drive.

    Raises: InputError: a file is missing.
    """
    files = [_folder() / "sample" / name for name in SAMPLE]
    missing = [str(file) for file in files if not file.is_file()]
    if missing:
        raise InputError("install.no_sample_drive", where=", ".join(missing))
    return files


def _folder() -> Path:
    """Return the library folder: next to the package in development, inside it after installation."""
    package = Path(__file__).parent
    in_development = package.parent / FOLDER
    return in_development if any(in_development.glob("*.toml")) else package / FOLDER
