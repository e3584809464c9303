"""Motions that several tests look at."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np

from insnav.simulate.motion.kinds import Vehicle
from insnav.simulate.truth import Truth

PLACE = np.array([np.radians(48.0), np.radians(11.0), 500.0])
_SAMPLE = runpy.run_path(str(Path(__file__).parents[2] / "trajectories" / "make_sample.py"))
# A car driven as that of the sample: speed, heading and grade change together within a segment.
Segment, drive = _SAMPLE["Segment"], _SAMPLE["drive"]


def town(start: float = 0.0, place: np.ndarray = PLACE, **body: object) -> Truth:
    """Two minutes of a car: at rest, off, through two bends, over a hill, and to rest again."""
    segments = (
        Segment(12.0),
        Segment(10.0, speed=14.0),
        Segment(6.0, turn=np.radians(80.0)),
        Segment(12.0, grade=0.05),
        Segment(8.0, speed=18.0, turn=np.radians(-120.0)),
        Segment(12.0, grade=-0.03),
        Segment(30.0, speed=9.0, turn=np.radians(200.0)),
        Segment(20.0, speed=0.0, grade=0.0),
        Segment(10.0),
    )
    return drive(segments, place, seed=7, heading=0.5, roll=0.01, pitch=-0.02, start=start, body=Vehicle(**body))
