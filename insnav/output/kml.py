"""The track of a run as KML, for map programs."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np

from insnav.plain_text import plain_text
from insnav.types import Trajectory

KML_POINTS = 5000  # more makes map programs slow and shows nothing new


def write_kml(folder: Path, solution: Trajectory, name: str) -> Path:
    """Write ``track.kml``, see `kml_text`; its path."""
    path = folder / "track.kml"
    path.write_text(kml_text(solution, name), encoding="utf-8", newline="\n")
    return path


def kml_text(solution: Trajectory, name: str) -> str:
    """Track on the ground, thinned to `KML_POINTS`, with its start and end.

    The height written is ellipsoidal, which map programs would take for height above sea level; so the track
    is clamped to the ground.
    """
    count = len(solution.time)
    rows = np.unique(np.linspace(0, count - 1, min(count, KML_POINTS)).round().astype(np.int64))
    lat, lon = np.degrees(solution.lla[rows, 0]), np.degrees(solution.lla[rows, 1])
    points = [
        f"{x:.8f},{y:.8f},{z:.3f}"
        for x, y, z in zip((lon + 180.0) % 360.0 - 180.0, lat, solution.lla[rows, 2], strict=True)
    ]
    parts = np.split(np.array(points), np.flatnonzero(np.abs(np.diff(lon)) > 180.0) + 1)  # at the date line
    lines = "".join(
        f"<LineString><tessellate>1</tessellate><coordinates>{' '.join(part)}</coordinates></LineString>\n"
        for part in parts
        if len(part) > 1
    )
    marks = "".join(
        f"<Placemark><name>{label} {time:.1f} s</name><Point><coordinates>{point}</coordinates></Point></Placemark>\n"
        for label, time, point in (
            ("start", solution.time[0], points[0]),
            ("end", solution.time[-1], points[-1]),
        )
    )
    title = escape(plain_text(name), quote=False)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n'
        f"<name>{title}</name>\n"
        '<Style id="track"><LineStyle><color>ffb27200</color><width>3</width></LineStyle></Style>\n'
        f"<Placemark><name>{title}</name><styleUrl>#track</styleUrl><MultiGeometry>\n{lines}"
        f"</MultiGeometry></Placemark>\n{marks}</Document></kml>\n"
    )
