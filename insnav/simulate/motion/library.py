"""Where the profiles are that come with insnav."""

from __future__ import annotations

from pathlib import Path

FOLDER = "trajectories"


def library(folder: Path | None = None) -> list[Path]:
    """Motion profiles of the library, or of another folder, in alphabetical order; none if it is not here."""
    package = Path(__file__).parents[2]
    # beside the package where it is developed, inside it where it was installed
    places = [package.parent / FOLDER, package / FOLDER] if folder is None else [folder]
    found = next((place for place in places if place.is_dir() and any(place.glob("*.toml"))), None)
    return [] if found is None else sorted(path for path in found.glob("*.toml") if path.stem != "corpus")
