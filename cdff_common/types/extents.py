# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Extents of messages: boxes around their positions."""

from __future__ import annotations

from typing import Any

import numpy as np

#: ``xmin ymin zmin xmax ymax zmax``, metres.
Box = tuple[float, float, float, float, float, float]

#: Type -> its positions: an array of x, y, z (more columns are ignored), a message, or a tuple of messages.
POSITIONS = {
    "BodyState": "pose",
    "BundleProblem": "points.positions",
    "KeyFrame": "pose",
    "LandmarkMap": "data.positions",
    "LidarMap": "points_m",
    "LidarScan": "data.points",
    "Mesh": "data.vertices",
    "ObjectDetections": "detections",
    "ObjectTrack": "data.poses",
    "Path": "waypoints",
    "PointSequence": "values",
    "Pointcloud": "data.points",
    "Pose": "pos",
    "PoseGraph": "vertices.poses",
    "PoseTrajectory": "data.poses",
    "PosesSequence": "items",
    "RigidBodyState": "pos",
    "Trajectory": "points",
    "TransformWithCovariance": "data.translation",
    "VisualPointFeatureVector3D": "points_m",
    "Waypoint": "position",
}


def box_around(positions: Any) -> Box | None:
    """Return the box around finite positions, given as in ``POSITIONS``; None without any."""
    if not isinstance(positions, np.ndarray):
        messages = positions if isinstance(positions, tuple) else (positions,)
        boxes = [box for message in messages if (box := message.extent_m()) is not None]
        positions = np.array(boxes).reshape(-1, 3)
    points = np.atleast_2d(positions)[:, :3]
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return None
    (x0, y0, z0), (x1, y1, z1) = finite.min(axis=0).tolist(), finite.max(axis=0).tolist()
    return (x0, y0, z0, x1, y1, z1)
