"""Where the profiles and the sample drive are that come with insnav."""

from __future__ import annotations

from pathlib import Path

from insnav.exceptions import InputError

FOLDER = "trajectories"
SAMPLE = ("imu.csv.gz", "gps.csv", "ref.csv")


def library(folder: Path | None = None) -> list[Path]:
    """Motion profiles of the library, or of another folder, in alphabetical order; none if it is not here."""
    found = _folder() if folder is None else folder
    return sorted(path for path in found.glob("*.toml") if path.stem != "corpus")


def sample_drive() -> list[Path]:
    """IMU, GPS and reference file of the sample drive.

    Raises: InputError: they are not here.
    """
    files = [_folder() / "sample" / name for name in SAMPLE]
    absent = [str(file) for file in files if not file.is_file()]
    if absent:
        raise InputError("install.no_sample_drive", where=", ".join(absent))
    return files


def _folder() -> Path:
    """Beside the package where it is developed, inside it where it was installed."""
    package = Path(__file__).parent
    beside = package.parent / FOLDER
    return beside if any(beside.glob("*.toml")) else package / FOLDER
