"""Lines and areas of a GeoJSON file behind the track of a run: streets, a circuit, a building."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from insnav.exceptions import InputError
from insnav.types import FloatArray
from insnav.units import DEG

FILE = "backdrop.geojson"
MOST = 50_000  # points that a page takes
_DEPTH = {"LineString": 0, "MultiLineString": 1, "Polygon": 1, "MultiPolygon": 2}  # lists of lists of points


def read_backdrop(file: Path) -> FloatArray:
    """Read the lines of a GeoJSON file (RFC 7946) on WGS-84.

    Returns: (n, 2) latitude and longitude [rad], a row of NaN behind each line.
    Raises: InputError: no GeoJSON, no line in it, places off the Earth, or too many points.
    """
    try:
        lines = list(_lines(json.loads(file.read_text(encoding="utf-8"))))
        points = [np.array([each[:2] for each in line], dtype=np.float64).reshape(-1, 2)[:, ::-1] for line in lines]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError("report.not_geojson", where=str(file), reason=str(error)) from error
    if not points:
        raise InputError("report.empty_backdrop", where=str(file))
    found = np.concatenate([np.vstack((each, np.full((1, 2), np.nan))) for each in points])
    if len(found) > MOST:
        raise InputError("report.large_backdrop", where=str(file), count=len(found), limit=MOST)
    if np.nanmax(np.abs(found[:, 0])) > 90.0 or np.nanmax(np.abs(found[:, 1])) > 180.0:
        raise InputError("report.backdrop_unit", where=str(file))
    return found * DEG


def write_backdrop(lines: FloatArray, file: Path) -> None:
    """Write such lines again."""
    parts = np.split(lines, np.flatnonzero(np.isnan(lines[:, 0])) + 1)
    coordinates = [np.round(each[:-1, ::-1] / DEG, 9).tolist() for each in parts if len(each) > 1]
    file.write_text(json.dumps({"type": "MultiLineString", "coordinates": coordinates}), encoding="utf-8")


def _lines(value: Any) -> Iterator[Any]:
    """Give every line and ring of an object and what it holds."""
    kind = value["type"]
    own = [value["geometry"]] if value.get("geometry") else []
    for part in value.get("features") or value.get("geometries") or own:
        yield from _lines(part)
    if kind in _DEPTH:
        found = [value["coordinates"]]
        for _ in range(_DEPTH[kind]):
            found = [each for part in found for each in part]
        yield from found
