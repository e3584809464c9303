"""Make the bench tables of ``laboratory/``: simulated sensors with the published figures of the laboratory.

Their noise is orthogonal to what is fitted, so that the fits return the published figures. The recorded tables are not
in the package.

python trajectories/make_laboratory.py [FOLDER]     # without FOLDER: trajectories/laboratory itself
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

LAB_TOML = """\
name = "laboratory"
[accel]
bias = "0.000489015 m/s^2"
[gyro]
bias = "0.00806 deg/h"
[initial]
tilt = "0.003 deg"
"""


def main(arguments: Sequence[str] = ()) -> None:
    """Write the tables."""
    folder = Path(arguments[0]) if arguments else Path(__file__).with_name("laboratory")
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(1)
    rate = np.sort(np.concatenate([np.arange(-90.0, 91.0, 10.0), [-5.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 5.0]]))
    ends = (rate[:, None] == [80.0, 90.0]).astype(float)  # beyond the linear part
    straight = np.column_stack([np.ones_like(rate), rate, ends])
    volts = straight @ [0.19999, 0.048788, -0.0960, -0.1900] + noise(rng, straight, 0.0048)
    write(folder / "gyro_rate_table.csv", {"rate_dps": rate, "voltage_v": volts})
    angle = np.arange(0.0, 360.0, 30.0)
    along, across = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    tumble = np.column_stack([np.ones_like(along), along, along**2, along * across])
    volts = tumble @ [-0.18467, -2.41212, 0.01127, -0.02113] + noise(rng, tumble, 0.02596)
    write(folder / "accel_tumble_12.csv", {"angle_deg": angle, "voltage_v": volts})
    biases = 0.18 + noise(rng, np.ones((5, 1)), np.sqrt(8.666e-5 * 4 / 5))
    write(folder / "gyro_bias_repeatability.csv", {"powerup": np.arange(1, 6), "published_value_dps": biases})
    (folder / "lab.toml").write_text(LAB_TOML, encoding="utf-8")


def noise(rng: np.random.Generator, design: NDArray[np.float64], rms: float) -> NDArray[np.float64]:
    """Draw noise (n,) of this root mean square, orthogonal to the columns of a design (n, k)."""
    drawn = rng.uniform(-1.0, 1.0, len(design))  # without outliers
    drawn -= design @ np.linalg.lstsq(design, drawn, rcond=None)[0]
    return np.asarray(drawn * rms / np.sqrt(np.mean(drawn**2)))


def write(path: Path, columns: dict[str, ArrayLike]) -> None:
    """Write columns, without rounding that the fits would see."""
    rows = ("{:g},{:.7f}".format(*row) for row in np.column_stack(list(columns.values())))
    path.write_text("\n".join([",".join(columns), *rows, ""]), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
