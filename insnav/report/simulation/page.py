"""What a simulated recording leaves on the disk: data files, the models behind them, figures, page, facts."""

from __future__ import annotations

import hashlib
import json
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from insnav.alignment.align import GYROCOMPASS_SD
from insnav.alignment.in_motion import SLOWEST
from insnav.earth import OMEGA_EARTH
from insnav.imu import ImuErrors, ImuSpec, calibration_to_toml, to_toml
from insnav.imu.specification import gyro_bias_sd
from insnav.output.data_files import write_gps, write_imu, write_reference
from insnav.output.folder import RunFolder
from insnav.report.numbers import number
from insnav.report.page import Table
from insnav.report.run_json import json_ready, versions
from insnav.report.save import model_facts
from insnav.report.sheet import Picture, Sheet, write_sheet
from insnav.report.simulation.profile_figures import draw_motion, draw_sketch, draw_way, way
from insnav.report.style import drawing
from insnav.simulate.recording import Recording, times
from insnav.simulate.truth import Kinematics, Truth
from insnav.types import FloatArray, Sampling
from insnav.units import DEG, DEG_PER_H, G0, PPM

if TYPE_CHECKING:
    from insnav.simulate.faults import Fault
    from insnav.simulate.gps_errors import GpsErrors, GpsSpec
    from insnav.simulate.motion import MotionProfile
    from insnav.simulate.truth_from_track import Residual

IDEAL = "ideal"  # name of a sensor without errors
_DRAWN = 20_000  # most instants of the motion that figures and facts look at
_DRAWN_RATE = 97.0  # no multiple of what people make motions of, whose peaks would all be missed [Hz]
_MARGIN = 12
_GRAVITY = {
    "plumb": "without its north component: for comparison with packages that leave it out",
    "linear": "without its north component, and linear in height: for comparison with packages that have it so",
}
_SAMPLES = {"mean": "means over their interval", "instant": "values at an instant", "increment": "increments"}


@dataclass(frozen=True, slots=True)
class Plan:
    """Everything a simulation is made from.

    Attributes
    ----------
    name, purpose : str
        Of the motion.
    source : mapping
        Where the motion comes from, for the facts.
    profile : str
        Text of the motion profile; empty if the motion is that of a recorded track.
    truth : Truth
        The motion.
    imu, gps : ImuSpec, GpsSpec or None
        Sensors; None for ideal ones.
    seed : int
        Of everything random.
    rate : float
        Of the IMU [Hz].
    sampling : {"mean", "instant", "increment"}
        What its samples are.
    faults : tuple of Fault
        What goes wrong.
    configuration : mapping
        Options as given.
    """

    name: str
    purpose: str
    source: Mapping[str, Any]
    profile: str
    truth: Truth
    imu: ImuSpec | None
    gps: GpsSpec | None
    seed: int
    rate: float
    sampling: Sampling
    faults: tuple[Fault, ...]
    configuration: Mapping[str, Any]


def write_recording(folder: RunFolder, plan: Plan, made: Recording) -> Path:
    """Write the whole folder and put it in its place.

    Parameters
    ----------
    folder : RunFolder
        Entered, not committed.
    plan : Plan
        What was simulated.
    made : Recording
        The result.

    Returns
    -------
    Path
        The finished folder.
    """
    write_imu(folder.path("imu.csv"), made.imu)
    write_gps(folder.path("gps.csv"), made.gps)
    write_reference(folder.path("ref.csv"), made.reference)
    texts = model_texts(plan)
    if made.specimen is not None:
        texts["specimen.toml"] = calibration_to_toml(made.specimen.errors)
    time, motion = seen(plan.truth)
    facts = {
        **plan_facts(plan, time, motion),
        "imu_samples": len(made.imu.time),
        "gps_fixes": len(made.gps.time),
        "lever_arm_m": made.lever_b,
        "specimen": None if made.specimen is None else specimen_facts(made.specimen.errors),
        "command": run_command(plan, made.lever_b, motion),
    }
    ready = json_ready(facts)
    sheet = Sheet(
        f"Simulated recording of {plan.name}",
        (*recording_lines(ready), _entry("next", ready["command"])),
        tuple(table for table in (motion_table(ready["motion"]), _specimen_table(ready["specimen"])) if table),
        motion_pictures(plan, time, motion),
        _assumptions(plan),
    )
    return write_sheet(folder, sheet, ready, texts)


def model_texts(plan: Plan) -> dict[str, str]:
    """Text files with what was simulated: motion profile, IMU and receiver."""
    texts = {}
    if plan.profile:
        texts["profile.toml"] = plan.profile
    if plan.imu is not None:
        texts["imu.toml"] = to_toml(plan.imu)
    if plan.gps is not None:
        from insnav.simulate import gps_file as gps_config  # needs pydantic

        texts["gps.toml"] = gps_config.to_toml(plan.gps)
    return texts


def plan_facts(plan: Plan, time: FloatArray, motion: Kinematics) -> dict[str, Any]:
    """Facts of every simulation, not yet JSON-ready.

    Parameters
    ----------
    plan : Plan
        What was simulated.
    time : (n,) array
        Instants to look at [s].
    motion : Kinematics
        The motion at these.
    """
    lat, lon, height = plan.truth.evaluate(np.array([plan.truth.start])).lla[0]
    speed = np.linalg.norm(motion.v_n, axis=1)
    return {
        "versions": versions(),
        "configuration": plan.configuration,
        "seed": plan.seed,
        "motion": {
            "name": plan.name,
            "purpose": plan.purpose,
            **plan.source,
            "start_s": plan.truth.start,
            "duration_s": plan.truth.duration,
            "gravity": plan.truth.gravity,
            "distance_m": way(time, motion),
            "start_lat_deg": lat / DEG,
            "start_lon_deg": lon / DEG,
            "start_height_m": height,
            "height_range_m": [motion.lla[:, 2].min(), motion.lla[:, 2].max()],
            "max_speed_m_s": speed.max(),
            "max_rate_deg_s": np.abs(motion.w_ib_b).max(axis=0) / DEG,
            "max_specific_force_m_s2": np.abs(motion.f_b).max(axis=0),
        },
        "imu_rate_hz": plan.rate,
        "imu_sampling": plan.sampling,
        "imu_model": {"name": IDEAL} if plan.imu is None else model_facts(plan.imu, "simulated"),
        "gps_model": IDEAL if plan.gps is None else plan.gps.name,
        "gps_lasting": None if plan.gps is None else _lasting(plan.gps.errors),
        "faults": plan.configuration.get("fault", []),
    }


def _lasting(errors: GpsErrors) -> dict[str, float]:
    """Share of the variance of a receiver's horizontal errors that lasts, and for how long."""
    drift, whole = np.array(errors.position_drift[:2]), errors.position_sd[:2]
    return {"share": float(np.sum(drift**2) / np.sum(whole**2)), "correlation_time_s": errors.correlation_time}


def twin_facts(residual: Residual) -> dict[str, Any]:
    """How far a twin is from its track, and why it may be none."""
    return {
        "position_rms_m": residual.position,
        "velocity_rms_m_s": residual.velocity,
        "farthest_m": residual.farthest,
        "farthest_time_s": residual.farthest_time,
        "max_acceleration_m_s2": residual.acceleration,
        "max_acceleration_time_s": residual.acceleration_time,
        "longest_gap_s": residual.gap,
        "doubts": list(residual.doubts),
    }


def plan_key(plan: Plan) -> str:
    """Digest of everything the runs of a plan depend on: what was simulated, and the releases that do it."""
    content = {
        "versions": versions(),
        "configuration": plan.configuration,
        "source": plan.source,
        "texts": model_texts(plan),
        "seed": plan.seed,
    }
    return hashlib.sha256(json.dumps(json_ready(content), sort_keys=True).encode()).hexdigest()


def write_sketches(folder: RunFolder, profiles: Sequence[MotionProfile], facts: Sequence[Mapping[str, Any]]) -> Path:
    """Draw a sketch of every profile into a folder and put it in its place.

    Parameters
    ----------
    folder : RunFolder
        Entered, not committed.
    profiles : sequence of MotionProfile
        What to draw.
    facts : sequence of mapping
        About each of them, for ``run.json``.
    """
    pictures = []
    with drawing():
        for profile in profiles:
            figure = draw_sketch(*seen(profile.truth(0)), profile.name, profile.purpose)
            pictures.append(Picture(profile.name, figure, profile.purpose))
    rows = tuple((each["name"], f"{each['duration_s']:.0f}", each["purpose"]) for each in facts)
    table = Table("Profiles", ("name", "duration [s]", "purpose"), rows)
    return write_sheet(folder, Sheet("Motion profiles", (), (table,), tuple(pictures)), {"profiles": list(facts)})


def seen(truth: Truth) -> tuple[FloatArray, Kinematics]:
    """Instants that figures and facts of a motion look at, and the motion there."""
    time = times(truth, min(_DRAWN_RATE, _DRAWN / truth.duration))
    return time, truth.evaluate(time)


def specimen_facts(errors: ImuErrors) -> dict[str, Any]:
    """Constant errors of the IMU that was drawn, in field units; all of them are in ``specimen.toml``."""
    return {
        "gyro_bias_deg_h": errors.gyro_bias / DEG_PER_H,
        "gyro_scale_ppm": (np.diag(errors.gyro_matrix) - 1.0) / PPM,
        "accel_bias_mg": errors.accel_bias / (1e-3 * G0),
        "accel_scale_ppm": (np.diag(errors.accel_matrix) - 1.0) / PPM,
    }


def run_command(plan: Plan, lever_b: FloatArray, motion: Kinematics) -> str:
    """Command that navigates the recording, said from inside its folder.

    Parameters
    ----------
    plan : Plan
        What was simulated.
    lever_b : (3,) array
        Antenna seen from the IMU, body axes [m].
    motion : Kinematics
        The motion, from its start on.
    """
    words = ["insnav", "run", "imu.csv", "--gps", "gps.csv", "--ref", "ref.csv"]
    if np.any(lever_b):
        words += ["--lever-arm", ",".join(f"{length:g}" for length in lever_b)]
    if plan.sampling == "instant":
        words += ["--imu-sampling", "instant"]
    if _hides_heading(plan, motion):
        words += ["--heading", f"{motion.rph[0, 2] / DEG:.1f}"]
    # a filter needs some idea of noise, also for an IMU that has none
    return " ".join([*words, "--imu", "navigation" if plan.imu is None else "imu.toml"])


def _hides_heading(plan: Plan, motion: Kinematics) -> bool:
    """Whether neither the course nor a gyrocompass can tell the heading."""
    # twice that speed: a course that is there for moments only tells nothing
    moves = float(np.linalg.norm(motion.v_n[:, :2], axis=1).max()) > 2.0 * SLOWEST
    if moves or plan.imu is None:
        return False
    earth = OMEGA_EARTH * max(math.cos(motion.lla[0, 0]), 1e-9)
    return bool(gyro_bias_sd(plan.imu.gyro).max() > GYROCOMPASS_SD * earth)


def in_folder(command: str, folder: Path) -> str:
    """Command from `run_command`, said from where the folder is given from."""
    names = {"imu.csv", "gps.csv", "ref.csv", "imu.toml"}
    return shlex.join(str(folder / word) if word in names else word for word in command.split())


def simulation_lines(facts: Mapping[str, Any], out: Path) -> list[str]:
    """Say what was simulated and how to go on.

    Parameters
    ----------
    facts : mapping
        As in ``run.json``.
    out : Path
        The folder as the user gave it.
    """
    return [
        *recording_lines(facts),
        _entry("files", f"{out}: imu.csv, gps.csv, ref.csv, report.html, run.json, …"),
        _entry("next", in_folder(facts["command"], out)),
    ]


def recording_lines(facts: Mapping[str, Any]) -> list[str]:
    """Say what was simulated."""
    samples = f"{facts['imu_samples']} samples at {facts['imu_rate_hz']:g} Hz, {_SAMPLES[facts['imu_sampling']]}"
    return [
        *motion_lines(facts),
        _entry("IMU", f"{facts['imu_model']['name']}: {samples}"),
        _entry("GPS", f"{facts['gps_model']}: {facts['gps_fixes']} fixes; seed {facts['seed']}"),
        *(_entry("fault", text) for text in facts["faults"]),
    ]


def motion_lines(facts: Mapping[str, Any]) -> list[str]:
    """Lines about the motion."""
    motion = facts["motion"]
    lines = [
        _entry(
            "motion",
            f"{motion['name']}: {motion['duration_s']:.1f} s, {number(motion['distance_m'])} m, up to "
            f"{number(motion['max_speed_m_s'])} m/s",
        )
    ]
    if motion["gravity"] != "full":
        lines.append(_entry("gravity", _GRAVITY[motion["gravity"]]))
    if "twin" not in motion:
        return lines
    twin = motion["twin"]
    velocity = "" if twin["velocity_rms_m_s"] is None else f" and {number(twin['velocity_rms_m_s'])} m/s"
    apart = f"{number(twin['position_rms_m'])} m{velocity} RMS from its track, at most {number(twin['farthest_m'])} m"
    return [*lines, _entry("twin", apart), *(_entry("doubt", text) for text in twin["doubts"])]


def _entry(name: str, text: str) -> str:
    return f"{name:<{_MARGIN}}{text}"


def motion_table(motion: Mapping[str, Any]) -> Table:
    """Rows about the motion.

    Parameters
    ----------
    motion : mapping
        ``motion`` of the facts.
    """
    low, high = motion["height_range_m"]
    rows = (
        ("duration [s]", f"{motion['duration_s']:.1f}"),
        ("distance [m]", number(motion["distance_m"], 4)),
        ("largest speed [m/s]", number(motion["max_speed_m_s"])),
        ("height [m]", f"{low:.1f} to {high:.1f}"),
        ("largest rate x, y, z [deg/s]", ", ".join(number(value) for value in motion["max_rate_deg_s"])),
        (
            "largest specific force x, y, z [m/s²]",
            ", ".join(number(value) for value in motion["max_specific_force_m_s2"]),
        ),
    )
    return Table(f"Motion: {motion['purpose'] or motion['name']}", ("", "value"), rows)


def motion_pictures(plan: Plan, time: FloatArray, motion: Kinematics) -> tuple[Picture, ...]:
    """Figures of the motion."""
    with drawing():
        return (
            Picture("way", draw_way(time, motion, plan.name), "The way over the ground"),
            Picture("motion", draw_motion(time, motion, plan.name), "What sensors without errors would feel"),
        )


def _specimen_table(specimen: Mapping[str, Any] | None) -> Table | None:
    if specimen is None:
        return None
    rows = tuple(
        (name, *(number(value) for value in specimen[key]))
        for name, key in (
            ("gyro bias [deg/h]", "gyro_bias_deg_h"),
            ("gyro scale factor [ppm]", "gyro_scale_ppm"),
            ("accelerometer bias [mg]", "accel_bias_mg"),
            ("accelerometer scale factor [ppm]", "accel_scale_ppm"),
        )
    )
    return Table("The IMU that was drawn", ("", "x", "y", "z"), rows, "constant errors; all of them: specimen.toml")


def _assumptions(plan: Plan) -> tuple[str, ...]:
    if plan.imu is None or not plan.imu.absent:
        return ()
    return (f"errors the IMU file does not give are zero: {', '.join(plan.imu.absent)}",)
