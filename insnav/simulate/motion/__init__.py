"""Motion profiles: conversion of a profile file to an exact motion.

profile.toml -> segments -> moves -> commands -> Truth
                waypoints -> way  -> commands
"""

from __future__ import annotations

from insnav.library import library
from insnav.simulate.motion.profile import MotionProfile, load_profile

__all__ = ["MotionProfile", "library", "load_profile"]
