# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Base classes of the generated types: validation, equality, a short ``repr``, ASN.1 name and extent.

``COLUMNS`` lists the types whose arrays have one row per element, ``POSITIONS`` those with an extent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from cdff_common.errors import InputError
from cdff_common.types.conversions import Conversions
from cdff_common.types.schema import fields_of
from cdff_common.types.schema_table import CHOICES, LARGE, MESSAGES
from cdff_common.types.summary import message_html, message_text
from cdff_common.types.validation import Check, check_of, same

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
    "VisualMap": "points_m",
    "VisualPointFeatureVector3D": "points_m",
    "Waypoint": "position",
}


class Columns(NamedTuple):
    """Columns of a type.

    Attributes
    ----------
    required : tuple of str
        Columns of every message; the first one defines the number of rows.
    optional : tuple of str
        Columns that may be empty.
    unique, ascending : str
        Column of unique ids, and of ascending numbers; empty for none.
    """

    required: tuple[str, ...]
    optional: tuple[str, ...] = ()
    unique: str = ""
    ascending: str = ""


COLUMNS = {
    "BundleCameras": Columns(("ids", "stamps", "poses", "lenses", "fixed"), unique="ids"),
    "BundleLenses": Columns(("values", "free")),
    "BundleObservations": Columns(("cameras", "points", "pixels")),
    "BundlePoints": Columns(("ids", "positions", "fixed"), unique="ids"),
    "BundlePrior": Columns(("cameras", "poses"), unique="cameras"),
    "GroundAreasData": Columns(("kinds", "areas", "ring_counts")),
    "ImuSpanData": Columns(("stamps", "acc", "gyro", "mag"), ascending="stamps"),
    "KeyFrameData": Columns(("keypoints",), ("scales", "landmarks", "descriptors")),
    "LandmarkMapData": Columns(
        ("ids", "positions"), ("covariances", "observations", "descriptors"), unique="ids"
    ),
    "LidarScanData": Columns(("points", "time_offsets"), ("intensity", "ring")),
    "MeshData": Columns(("vertices",), ("normals", "colors")),
    "ObjectTrackData": Columns(
        ("stamps", "poses"),
        ("velocities", "covariances", "velocity_covariances", "bearings", "pixels", "pixel_sigmas"),
        ascending="stamps",
    ),
    "PointCloudData": Columns(("points",), ("colors", "intensity")),
    "PoseGraphEdges": Columns(("ends", "poses", "information", "kinds")),
    "PoseGraphVertices": Columns(("ids", "stamps", "poses"), ("fixed",), unique="ids"),
    "PoseTrajectoryData": Columns(("stamps", "poses"), ("covariances",), ascending="stamps"),
}


class Message(Conversions):
    """Base of every type: immutable, compared by value, not hashable."""

    __slots__ = ()
    #: Name of the type in the ASN.1 modules.
    ASN1_NAME: ClassVar[str] = ""
    __hash__ = None  # type: ignore[assignment]  # arrays have no hash

    def __post_init__(self) -> None:
        """Validate the fields by the schema of the type, then their consistency; raises InputError."""
        for attribute, where, check in _checks(self.ASN1_NAME):
            value = getattr(self, attribute)
            checked = check(value, where)
            if checked is not value:
                object.__setattr__(self, attribute, checked)
        self._check_consistency()

    def __eq__(self, other: object) -> bool:
        """Compare type and fields: arrays by shape and element, NaN equal to NaN."""
        if type(self) is not type(other):
            return NotImplemented
        return all(same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))  # type: ignore[arg-type]

    def __reduce__(self) -> tuple[Any, ...]:
        """Return constructor and arguments, so that the arrays of copies and pickles are read-only too."""
        return type(self), tuple(getattr(self, f.name) for f in fields(self))  # type: ignore[arg-type]

    def __repr__(self) -> str:
        """Return the fields, large arrays as dtype, shape and range."""
        return message_text(self)

    def _repr_html_(self) -> str:
        """Return the content and the fields for notebooks."""
        return message_html(self)

    def _check_consistency(self) -> None:
        """Check the conditions on several fields, after the validation of each."""
        _check_rows(self)

    def extent_m(self) -> Box | None:
        """Return the box ``xmin ymin zmin xmax ymax zmax`` of the content in its frame, metres, or None."""
        path = POSITIONS.get(self.ASN1_NAME)
        return None if path is None else box_around(attrgetter(path)(self))


class ChoiceMessage(Message):
    """Base of the types of a CHOICE, with the fields ``kind`` and ``value``."""

    __slots__ = ()
    if TYPE_CHECKING:
        kind: str
        value: Any

    def __post_init__(self) -> None:
        """Validate the value by the schema of its kind; raises InputError."""
        alternatives = {attribute: (where, check) for attribute, where, check in _checks(self.ASN1_NAME)}
        if self.kind not in alternatives:
            expected = ", ".join(alternatives)
            raise InputError(f"{type(self).__name__}.kind={self.kind!r}: expected one of {expected}")
        where, check = alternatives[self.kind]
        object.__setattr__(self, "value", check(self.value, where))


class FramedMessage(Message):
    """Base of the types whose metadata name the frame of their coordinates."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: Any

    @property
    def frame(self) -> str:
        """Frame of the coordinates."""
        frame: str = self.metadata.frame_id
        return frame


class CapturedMessage(FramedMessage):
    """Base of the types whose metadata have frame, start and end of capture."""

    __slots__ = ()

    @property
    def t0_ns(self) -> int:
        """Start of capture, nanoseconds."""
        t0_ns: int = self.metadata.start_time.ns
        return t0_ns

    @property
    def t1_ns(self) -> int:
        """End of capture, nanoseconds."""
        t1_ns: int = self.metadata.end_time.ns
        return t1_ns

    @property
    def stamp_ns(self) -> int:
        """End of capture, nanoseconds."""
        return self.t1_ns


class PoseMessage(Message):
    """Base of the types whose metadata name the two frames of a pose."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: Any

    @property
    def parent_frame(self) -> str:
        """Frame in which the child's poses are expressed."""
        frame: str = self.metadata.parent_frame_id
        return frame

    @property
    def child_frame(self) -> str:
        """Frame whose poses are given."""
        frame: str = self.metadata.child_frame_id
        return frame


@cache
def _checks(name: str) -> tuple[tuple[str, str, Check], ...]:
    """Return attribute, path for error messages and check of each field or alternative of a type."""
    node = CHOICES.get(name) or MESSAGES[LARGE.get(name, name)]
    return tuple((f.attribute, f"{node.class_name}.{f.attribute}", check_of(f.node)) for f in fields_of(node))


def box_around(positions: Any) -> Box | None:
    """Return the box around finite positions, given as in ``POSITIONS``; None without any."""
    if isinstance(positions, np.ndarray):
        points = np.atleast_2d(positions)[:, :3]
    else:
        messages = positions if isinstance(positions, tuple) else (positions,)
        boxes = [box for message in messages if (box := message.extent_m()) is not None]
        corners = np.array(boxes).reshape(-1, 3)
        points = corners
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return None
    (x0, y0, z0), (x1, y1, z1) = finite.min(axis=0).tolist(), finite.max(axis=0).tolist()
    return (x0, y0, z0, x1, y1, z1)


def _check_rows(message: Any) -> None:
    """Check the numbers of rows of a type in ``COLUMNS``, and that ids are unique or stamps ascend."""
    name = type(message).__name__
    if name not in COLUMNS:
        return
    required, optional, unique, ascending = COLUMNS[name]
    rows = len(getattr(message, required[0]))
    check_columns(name, rows, {column: getattr(message, column) for column in required})
    for column in optional:
        if (count := _rows(getattr(message, column))) not in (0, rows):
            raise InputError(f"{name}.{column}: {count} rows, expected {rows}, or none")
    if unique and len(np.unique(getattr(message, unique))) != rows:
        raise InputError(f"{name}.{unique}: repeated id, expected unique ids")
    if ascending and not (np.diff(getattr(message, ascending)) > 0).all():
        raise InputError(f"{name}.{ascending}: expected ascending {ascending}")


def check_columns(where: str, rows: int, columns: Mapping[str, Any]) -> None:
    """Check that columns have ``rows`` rows."""
    for name, column in columns.items():
        if _rows(column) != rows:
            raise InputError(f"{where}.{name}: {_rows(column)} rows, expected {rows}")


def _rows(column: Any) -> int:
    """Return the number of rows of an array or of an ``Array3D``."""
    return len(column) if isinstance(column, np.ndarray) else int(column.rows)
