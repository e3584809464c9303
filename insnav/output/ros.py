"""A trajectory as a ROS 1 bag: NavSatFix, the velocity that goes with it, and Odometry from its first epoch.

References
----------
ROS sensor_msgs, geometry_msgs and nav_msgs, noetic: how messages are written; REP-103, REP-105 (axes: East, North, Up;
Forward, Left, Up).
"""

from __future__ import annotations

import struct
import tempfile
from pathlib import Path

import numpy as np

from insnav.attitude import dcm_from_quat, quat_multiply
from insnav.exceptions import ConfigError
from insnav.output.track import Track
from insnav.output.tum import tangent_poses

_FIX, _TWIST, _ODOMETRY = "sensor_msgs/msg/NavSatFix", "geometry_msgs/msg/TwistStamped", "nav_msgs/msg/Odometry"
_TOPICS = {_FIX: "/fix", _TWIST: "/vel", _ODOMETRY: "/odom"}
_HALF_ROLL = np.array([0.0, 1.0, 0.0, 0.0])  # quaternion from Forward-Left-Up to Forward-Right-Down


def bag(track: Track) -> bytes:
    """ROS 1 bag; heights in NavSatFix are those of the run.

    Raises: ConfigError: no date is known, or `rosbags` is not installed.
    """
    try:
        from rosbags.rosbag1 import Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ConfigError("output.no_rosbags", reason=str(error)) from error
    instants = (track.instants("utc") - np.datetime64(0, "ns")).astype(np.int64).tolist()
    place, q, v = tangent_poses(track.trajectory)
    q = quat_multiply(q, _HALF_ROLL)
    level = track.trajectory.v_n[:, [1, 0, 2]] * [1.0, 1.0, -1.0]  # East, North, Up here, not at the first epoch
    body = np.einsum("nji,nj->ni", dcm_from_quat(q), v)
    sd = track.sd[:, [1, 0, 2]]  # rows of covariances are East, North, Up
    known = np.asarray(np.isfinite(sd).all(axis=1))
    variance = np.where(known[:, None], sd, 0.0) ** 2
    store = get_typestore(Stores.ROS1_NOETIC)
    with tempfile.TemporaryDirectory(prefix="insnav-") as folder:
        path = Path(folder) / "track.bag"
        with Writer(path) as writer:
            to = {kind: writer.add_connection(topic, kind, typestore=store) for kind, topic in _TOPICS.items()}
            for i, (ns, lla) in enumerate(zip(instants, track.degrees.tolist(), strict=True)):
                head = struct.pack("<III", i, *divmod(ns, 10**9))
                covariance = np.diag(variance[i])
                fix = struct.pack("<bH12dB", 0, 1, *lla, *covariance.ravel(), 2 if known[i] else 0)
                twist, pose = np.zeros((6, 6)), np.zeros((6, 6))
                pose[:3, :3] = covariance
                odometry = (*place[i], *q[i, [1, 2, 3, 0]], *pose.ravel(), *body[i], 0.0, 0.0, 0.0, *twist.ravel())
                writer.write(to[_FIX], ns, head + _text("gps") + fix)
                writer.write(to[_TWIST], ns, head + _text("enu") + struct.pack("<6d", *level[i], 0.0, 0.0, 0.0))
                writer.write(
                    to[_ODOMETRY], ns, head + _text("enu") + _text("base_link") + struct.pack("<85d", *odometry)
                )
        return path.read_bytes()


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()
