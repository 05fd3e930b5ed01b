# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Frames that a robot has, and the one that was probably meant."""

from __future__ import annotations

from collections.abc import Collection
from difflib import get_close_matches

from cdff_common.geometry.urdf import read_urdf
from cdff_common.interfaces.dfpc import DfpcContext


def known_frames(context: DfpcContext) -> frozenset[str]:
    """Return the frames of a robot, also those of its joints; none if no frame is stated."""
    frames = {*context.frames.frames, *(str(entry.get("frame", "")) for entry in context.sensors.values())}
    if context.urdf:
        model = read_urdf(context.urdf)
        for joint in model.joints:
            frames |= {model.frame(context.robot, joint.parent), model.frame(context.robot, joint.child)}
    frames.discard("")
    return frozenset(frames | {f"{context.robot}/base"}) if frames else frozenset()


def nearest_frame(frame: str, known: Collection[str]) -> str:
    """Return the known frame with the most similar name; empty if none is similar."""
    return next(iter(get_close_matches(frame, sorted(known), n=1, cutoff=0.7)), "")
