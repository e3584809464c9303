"""Where the profiles are that come with insnav."""

from __future__ import annotations

from pathlib import Path

FOLDER = "trajectories"


def library(folder: Path | None = None) -> list[Path]:
    """Find the profiles of the library, by name.

    Parameters
    ----------
    folder : Path, optional
        Other folder to look into.

    Returns
    -------
    list of Path
        Motion profiles, in alphabetical order; none if the library is not here.
    """
    package = Path(__file__).parents[2]
    # beside the package where it is developed, inside it where it was installed
    places = [package.parent / FOLDER, package / FOLDER] if folder is None else [folder]
    found = next((place for place in places if place.is_dir() and any(place.glob("*.toml"))), None)
    return [] if found is None else sorted(path for path in found.glob("*.toml") if path.stem != "corpus")
