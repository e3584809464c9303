"""Draw the pictures of README and manual: ``python reports/pictures.py [NAME…]``.

Each picture carries the numbers that it shows. A test makes them again and compares, so that no picture shows what the
code no longer draws. The page is drawn by Chromium.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image
from PIL.PngImagePlugin import PngInfo

import insnav
from insnav.errors.budget.from_windows import WindowSettings
from insnav.library import sample_drive
from insnav.report.figures import drawing, save
from insnav.report.save import page_of

HERE = Path(__file__).parent
KEY = "insnav"  # of the numbers in a picture
POINTS = 40  # of a line that are kept
WINDOW = "1100,1120"  # of the browser [pixels]
Numbers = dict[str, list[float]]


def of_figure(figure: Figure) -> Numbers:
    """Heights of lines, at some points, and sizes of bars."""
    found: Numbers = {}
    for k, axes in enumerate(figure.axes):
        for line in axes.lines:
            y = np.asarray(line.get_ydata(), dtype=float)
            found[f"{k} line {len(found)}"] = y[np.linspace(0, len(y) - 1, min(len(y), POINTS)).astype(int)].tolist()
        bars = [bar for bar in axes.patches if isinstance(bar, Rectangle)]
        if bars:
            found[f"{k} bars"] = [float(bar.get_width() * bar.get_height()) for bar in bars]
    return {name: values for name, values in found.items() if np.all(np.isfinite(values))}


def _drive() -> insnav.Drive:
    imu, gps, ref = sample_drive()
    return insnav.load(imu, gps=gps, ref=ref)


def _budget() -> Figure:
    imu, gps, ref = sample_drive()
    known = {"lever_arm": (0.8, -0.3, -1.2), "imu": str(Path(imu).parent / "imu.toml"), "ref_sd": (0.01, 0.005)}
    drive = insnav.load(imu, gps=gps, ref=ref, **known)  # type: ignore[arg-type]
    return drive.budget(runs=300, windows=WindowSettings(replicas=0)).plot("growth")


FIGURES: dict[str, Callable[[], Figure]] = {
    "sample_position_error": lambda: _drive().navigate().plot("position_error"),
    "sample_budget": _budget,
}
PAGE = "sample_run_page"


def of_page() -> Numbers:
    """Figures of merit at the top of the page of the sample drive."""
    merits = page_of(_drive().navigate()).merits
    return {each.key: np.atleast_1d(each.value).astype(float).tolist() for each in merits}


def numbers(name: str) -> Numbers:
    """What a picture would show today."""
    return of_page() if name == PAGE else of_figure(FIGURES[name]())


def carried(name: str) -> Numbers:
    """What the picture that is kept shows."""
    with Image.open(HERE / f"{name}.png") as picture:
        return dict(json.loads(picture.info[KEY]))


def draw(name: str) -> None:
    """Draw a picture, and put its numbers into it."""
    file = HERE / f"{name}.png"
    if name == PAGE:
        found = of_page()
        with tempfile.TemporaryDirectory() as folder:
            imu, gps, ref = sample_drive()
            insnav.load(imu, gps=gps, ref=ref).navigate().save(Path(folder) / "run")
            view = ["chromium", "--headless", "--no-sandbox", "--hide-scrollbars", f"--window-size={WINDOW}"]
            page = (Path(folder) / "run" / "report.html").as_uri()
            subprocess.run([*view, "--virtual-time-budget=5000", f"--screenshot={file}", page], check=True)
    else:
        with drawing():
            figure = FIGURES[name]()
            found = of_figure(figure)
            save(figure, file.with_suffix(""), "png")
    text = PngInfo()
    text.add_text(KEY, json.dumps(found))
    with Image.open(file) as picture:
        picture.convert("RGB").quantize(256, Image.Quantize.FASTOCTREE).save(
            file, pnginfo=text, optimize=True
        )  # half the size


if __name__ == "__main__":
    for each in sys.argv[1:] or (*FIGURES, PAGE):
        draw(each)
