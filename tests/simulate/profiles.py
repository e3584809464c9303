"""Motion profiles from a few lines of text."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insnav.earth import ned_offset
from insnav.simulate.motion import MotionProfile, load_profile
from insnav.simulate.truth import Kinematics, Truth

HEAD = 'purpose = "to test"\nvehicle = "{vehicle}"\n[start]\nlat = "{lat}"\nlon = "9 deg"\nheight = "100 m"\n{start}\n'
STILL = "[vibration]\nsuspension = 0\n"


def segments(*lines: str) -> str:
    """TOML of segments, each given as ``kind: key = value, …``."""
    tables = []
    for line in lines:
        kind, _, keys = line.partition(":")
        inline = f'{{ kind = "{kind.strip()}"{", " + keys.strip() if keys.strip() else ""} }}'
        tables.append(inline)
    return "segment = [\n" + ",\n".join(tables) + ",\n]\n"


def profile(
    folder: Path, *lines: str, vehicle: str = "car", start: str = "", lat: str = "45 deg", vibration: str = STILL
) -> MotionProfile:
    """Profile of these segments."""
    path = folder / "profile.toml"
    path.write_text(segments(*lines) + HEAD.format(vehicle=vehicle, start=start, lat=lat) + vibration)
    return load_profile(path)


@dataclass(frozen=True)
class Motion:
    """A motion at even instants, over the ground of its start."""

    truth: Truth
    time: np.ndarray
    at: Kinematics
    ned: np.ndarray  # from the start [m]

    @property
    def ahead(self) -> np.ndarray:
        """Distance travelled over ground and upwards [m]."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.ned, axis=0), axis=1))])

    @property
    def speed(self) -> np.ndarray:
        return np.linalg.norm(self.at.v_n, axis=1)

    @property
    def heading(self) -> np.ndarray:
        """Without jumps [rad]."""
        return np.unwrap(self.at.rph[:, 2])

    @property
    def acceleration(self) -> np.ndarray:
        """Of the velocity over ground [m/s^2]."""
        return np.gradient(self.at.v_n, self.time, axis=0, edge_order=2)

    @property
    def jerk(self) -> np.ndarray:
        """[m/s^3]."""
        return np.gradient(self.acceleration, self.time, axis=0, edge_order=2)


def motion(made: MotionProfile, step: float = 0.01, seed: int = 0) -> Motion:
    """Look at a profile."""
    truth = made.truth(seed)
    time = truth.start + np.append(np.arange(0.0, truth.duration, step), truth.duration)
    if time[-1] - time[-2] < 0.5 * step:
        time = np.delete(time, -2)
    at = truth.evaluate(time)
    return Motion(truth, time, at, ned_offset(at.lla, at.lla[0]))
