"""Lines behind the track: read from GeoJSON, kept with the run, drawn where they lie."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insnav.earth import ned_offset
from insnav.exceptions import InputError
from insnav.report.panels import panel_data
from insnav.report.run.page import MOST_POINTS, read_backdrop, write_backdrop
from insnav.result import open_result

STREET = {"type": "LineString", "coordinates": [[11.0, 48.0], [11.01, 48.0, 500.0], [11.01, 48.02]]}
AREA = {"type": "Polygon", "coordinates": [[[11.0, 48.0], [11.1, 48.0], [11.1, 48.1], [11.0, 48.0]]]}
MAP = {
    "type": "FeatureCollection",
    "features": [
        {"type": "Feature", "properties": {}, "geometry": {"type": "GeometryCollection", "geometries": [STREET, AREA]}},
        {"type": "Feature", "geometry": {"type": "MultiLineString", "coordinates": [STREET["coordinates"]]}},
        {"type": "Feature", "geometry": {"type": "Point", "coordinates": [11.0, 48.0]}},
        {"type": "Feature", "geometry": None},
    ],
}


def file_of(folder: Path, value: Any) -> Path:
    file = folder / "map.geojson"
    file.write_text(json.dumps(value), encoding="utf-8")
    return file


def test_lines_are_read_and_written(tmp_path: Path):
    found = read_backdrop(file_of(tmp_path, MAP))
    assert np.isnan(found[:, 0]).sum() == 3
    np.testing.assert_allclose(np.degrees(found[2]), [48.02, 11.01])
    write_backdrop(found, tmp_path / "again.geojson")
    np.testing.assert_allclose(read_backdrop(tmp_path / "again.geojson"), found, atol=1e-10)


@pytest.mark.parametrize(
    ("value", "word"),
    [
        ([1, 2], "report.not_geojson"),
        ({"type": "Point", "coordinates": [1.0, 2.0]}, "report.empty_backdrop"),
        ({"type": "LineString", "coordinates": [[4.4e5, 5.4e6], [4.5e5, 5.4e6]]}, "report.backdrop_unit"),
        ({"type": "LineString", "coordinates": [["a", "b"]]}, "report.not_geojson"),
        ({"type": "LineString", "coordinates": [[1.0, 2.0]] * (MOST_POINTS + 1)}, "report.large_backdrop"),
    ],
)
def test_what_cannot_be_drawn_is_refused(tmp_path: Path, value: Any, word: str):
    with pytest.raises(InputError, match=word):
        read_backdrop(file_of(tmp_path, value))


def test_it_is_kept_with_the_run_and_drawn_in_metres(navigated: Any, tmp_path: Path):
    lines = read_backdrop(file_of(tmp_path, STREET))
    made = replace(navigated, found=replace(navigated.found, backdrop=lines))
    again = open_result(made.save(tmp_path / "run", figures="none"))
    line, _, rejected = panel_data(again.page().panels[0])["behind"]
    assert rejected["name"] == "position rejected (3)"
    east, north = (np.frombuffer(base64.b64decode(line[key]), "<f4") for key in ("x", "y"))
    origin = made.found.run.solution.lla[0]
    expected = ned_offset(np.column_stack((lines, np.full(len(lines), origin[2]))), origin)
    np.testing.assert_allclose(north, expected[:, 0], rtol=1e-4, atol=0.1)
    np.testing.assert_allclose(east, expected[:, 1], rtol=1e-4, atol=0.1)
