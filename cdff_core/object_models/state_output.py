# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outputs of a tracker of one body: its pose and its track."""

from __future__ import annotations

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Output
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import ObjectTrack, ObjectTrackStatusT
from cdff_core.object_models.prepared import model_name
from cdff_core.object_models.tracked_state import TrackedState


def state_outputs(
    state: TrackedState | None,
    *,
    stamp_ns: int,
    frame: str,
    child: str,
    track_id: int,
    is_confirmed: bool,
    quality: Quality,
    inputs: tuple[str, ...],
    producer: str,
) -> list[Output]:
    """Return the outputs ``pose`` and ``track`` of a state; without values if there is none or it FAILED.

    Parameters
    ----------
    frame, child : str
        Frames of the sensor and of the body.
    is_confirmed : bool
        The track is confirmed, not tentative.
    """
    pose = Output.of_pose(
        "pose",
        None if state is None else UncertainTransform(state.T, state.covariance[:6, :6]),
        stamp_ns=stamp_ns,
        frame=frame,
        child=child,
        quality=quality,
        inputs=inputs,
        producer=producer,
    )
    track = None
    if state is not None and quality.status is not Status.FAILED:
        track = ObjectTrack.from_arrays(
            track_id,
            [stamp_ns],
            state.T[None],
            frame=frame,
            label=model_name(child),
            status=ObjectTrackStatusT.TRACK_CONFIRMED if is_confirmed else ObjectTrackStatusT.TRACK_TENTATIVE,
            score=1.0,
            velocities=state.velocities[None],
            covariances=state.covariance[None, :6, :6],
            velocity_covariances=state.velocity_covariance[None],
            producer=producer,
        )
    return [pose, Output("track", track, stamp_ns, stamp_ns, frame, quality=quality, inputs=inputs)]
