# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses of captures without known poses: each is registered with the surface of the previous ones."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import DegenerateGeometryError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.direction_names import direction_names
from cdff_common.geometry.kdtree import kd_tree, nearest, spacing
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.registration_3d.interface import Registration3DInputs
from cdff_core.dfpcs.reconstruction_3d.directions import Directions
from cdff_core.object_models.scan_parts import bodies

#: Fewest points of a capture, and fewest of them that agree with the surface.
_MIN_POINTS, _MIN_AGREEING = 40, 30
#: Smallest fraction of the points that agree with the surface: the others are on a new part of it.
_MIN_AGREEMENT = 0.5
#: Points closer than this number of median distances between neighbours belong to one body, and
#: ``bodies`` links points closer than a quarter of its diameter.
_LINK_SPACINGS, _DIAMETERS_PER_LINK = 8.0, 4.0
#: A second body has at least this fraction of the points of the first.
_SECOND_BODY = 0.2
#: Points within this number of radii of the surface so far belong to the body.
_REACH = 2.0
#: Standard deviations within which a point agrees with the surface, and factor of the covariance: errors of
#: neighbouring points correlate.
_SIGMAS, _INFLATION = 3.0, 1.5
#: Standard deviation of an error that all points of a capture share, in those of a range.
_COMMON = 0.5
#: Information per point, for displacements in radii of the body, below which a direction is not constrained.
_MIN_INFORMATION = 0.0004
#: Largest standard deviation of a direction that only the prediction determines, in radii of the body.
_WEAK = 0.1
#: Number of poses from which the error of the predictions is known, and of errors from which it follows.
_LEAST_POSES, _INNOVATIONS = 4, 10
#: Number of captures, and rotation between them, rad, over which velocity and rate are averaged.
_AVERAGED, _AVERAGED_RAD = 10, 0.7
#: Rotation since the last capture, rad, above which a registration could converge to a wrong pose.
_LOST_RAD = 0.6
#: Cells of the surface along each axis: 21 bits each.
_CELLS = 1 << 20


@dataclass(slots=True)
class _Surface:
    """Mean points and normals of cells in the frame of the model.

    Opposite sides of a thin panel are in different cells, because each cell belongs to one direction of the
    normals. ``capture`` is the number of the capture that observed the cell first.
    """

    cell_m: float
    keys: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    sums: FloatArray = field(default_factory=lambda: np.zeros((0, 6)))
    counts: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    capture: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def add(self, points_m: FloatArray, normals: FloatArray, capture: int) -> None:
        """Add points (n, 3) with normals (n, 3)."""
        cells = np.clip(np.floor(points_m / self.cell_m).astype(np.int64) + _CELLS // 2, 0, _CELLS - 1)
        axis = np.argmax(np.abs(normals), axis=1)
        facing = 2 * axis + (normals[np.arange(len(normals)), axis] > 0.0)
        cell_keys = (cells[:, 0] * _CELLS + cells[:, 1]) * _CELLS + cells[:, 2]
        keys = np.concatenate([self.keys, 6 * cell_keys + facing])
        sums = np.concatenate([self.sums, np.hstack([points_m, normals])])
        counts = np.concatenate([self.counts, np.ones(len(points_m), np.int64)])
        captures = np.concatenate([self.capture, np.full(len(points_m), capture)])
        self.keys, first, rows = np.unique(keys, return_index=True, return_inverse=True)
        self.sums = np.stack([np.bincount(rows, column) for column in sums.T], axis=1)
        self.counts = np.bincount(rows, counts).astype(np.int64)
        self.capture = captures[first]

    @property
    def points_m(self) -> FloatArray:
        """Points (m, 3)."""
        return np.asarray(self.sums[:, :3] / self.counts[:, None])

    @property
    def normals(self) -> FloatArray:
        """Unit normals (m, 3)."""
        return np.asarray(self.sums[:, 3:] / np.linalg.norm(self.sums[:, 3:], axis=1, keepdims=True))


@dataclass(frozen=True, slots=True, eq=False)
class LocatedCapture:
    """Pose ``T_model_sensor`` of a capture, and directions that only the prediction determines."""

    pose: UncertainTransform
    weak: tuple[str, ...]


class SurfaceRegistration:
    """Pose of each capture relative to the surface of the previous captures of an unknown body.

    The motion between two captures is predicted with the last velocity and rate. The frame of the model has
    the axes of the sensor at the first capture, and its origin in the middle of the points of this capture.

    Parameters
    ----------
    register : Dfn
        Registration3D.
    cell_m : float
        Edge of the cells of the surface, metres.
    """

    def __init__(self, register: Dfn[Any, Any, Any], cell_m: float) -> None:
        self._register = register
        self._surface = _Surface(cell_m)
        self._stamps_ns: list[int] = []
        self._poses: list[FloatArray] = []
        self._covariances: list[FloatArray] = []
        self._innovations: deque[FloatArray] = deque(maxlen=_INNOVATIONS)

    def locate(
        self, stamp_ns: int, points_m: FloatArray, normals: FloatArray, sigma_m: float
    ) -> LocatedCapture:
        """Return the pose of a capture and add its points to the surface.

        Parameters
        ----------
        points_m, normals : ndarray, shape (n, 3)
            In the frame of the sensor.
        sigma_m : float
            Standard deviation of a range, metres.

        Raises
        ------
        RefusedError
            ``few_points``, ``several_bodies``, ``late``, ``lost``, ``not_registered`` or ``degenerate``.
        """
        if len(points_m) < _MIN_POINTS:
            raise RefusedError("few points", [f"few_points:{len(points_m)}<{_MIN_POINTS}"])
        weak: list[str] = []
        if not self._poses:
            _require_one_body(points_m)
            T, covariance = se3.transform(np.eye(3), -points_m.mean(axis=0)), np.zeros((6, 6))
        else:
            if stamp_ns <= self._stamps_ns[-1]:
                raise RefusedError("capture before the last one", ["late"])
            guess = self._predicted(stamp_ns)
            is_of_body = self._is_of_body(se3.transform_points(guess, points_m))
            points_m, normals = points_m[is_of_body], normals[is_of_body]
            if len(points_m) < _MIN_POINTS:
                raise RefusedError("few points", [f"few_points:{len(points_m)}<{_MIN_POINTS}"])
            T, covariance, weak = self._registered(guess, points_m, normals, sigma_m)
        self._surface.add(
            se3.transform_points(T, points_m), np.asarray(normals @ T[:3, :3].T), len(self._poses)
        )
        self._stamps_ns.append(stamp_ns)
        self._poses.append(T)
        self._covariances.append(covariance)
        to_sensor = np.block([[np.eye(3), -se3.skew(T[:3, 3])], [np.zeros((3, 3)), np.eye(3)]])
        return LocatedCapture(UncertainTransform(T, to_sensor @ covariance @ to_sensor.T), tuple(weak))

    def _predicted(self, stamp_ns: int) -> FloatArray:
        """Return T_model_sensor with the mean velocity and rate of the last captures.

        RefusedError if the body has rotated too far since the last one.
        """
        last, last_ns = self._poses[-1], self._stamps_ns[-1]
        motion, duration_ns = np.zeros(6), 1
        for T, start_ns in zip(reversed(self._poses[-_AVERAGED:-1]), self._stamps_ns[-2::-1], strict=False):
            step = se3.log_se3(se3.inverse(T) @ last)
            if np.linalg.norm(step[3:]) > _AVERAGED_RAD and motion.any():
                break
            motion, duration_ns = step, last_ns - start_ns
        motion = (stamp_ns - last_ns) / duration_ns * motion
        if np.linalg.norm(motion[3:]) > _LOST_RAD:
            raise RefusedError("the body has rotated too far since the last capture", ["lost"])
        return np.asarray(last @ se3.exp_se3(motion))

    def _is_of_body(self, points_m: FloatArray) -> np.ndarray:
        """Return the mask (n,) of the points near the surface so far."""
        surface_m = self._surface.points_m
        centre = 0.5 * (surface_m.min(axis=0) + surface_m.max(axis=0))
        radius_m = np.linalg.norm(surface_m - centre, axis=1).max()
        return np.asarray(np.linalg.norm(points_m - centre, axis=1) < _REACH * radius_m)

    def _registered(
        self, guess: FloatArray, points_m: FloatArray, normals: FloatArray, sigma_m: float
    ) -> tuple[FloatArray, FloatArray, list[str]]:
        """Return T_model_sensor of a capture near a guess, the covariance (6, 6) of the displacement and
        rotation of the whole capture about the origin of the model, and the directions of the guess.
        """
        surface_m, surface_normals = self._surface.points_m, self._surface.normals
        rows = np.flatnonzero(np.sum((guess[:3, 3] - surface_m) * surface_normals, axis=1) > 0.0)
        if len(rows) < _MIN_POINTS:
            raise RefusedError("no surface that faces the sensor", ["not_registered"])
        surface_m, surface_normals = surface_m[rows], surface_normals[rows]
        try:
            T = self._register.process(
                Registration3DInputs(
                    source=points_m, target=surface_m, target_normals=surface_normals, guess=guess
                )
            ).transform
        except DegenerateGeometryError as error:
            raise RefusedError("no overlap with the surface", ["not_registered"]) from error
        model_m, model_normals = se3.transform_points(T, points_m), normals @ T[:3, :3].T
        distance_m, nearest_row = nearest(kd_tree(surface_m), model_m)
        n = surface_normals[nearest_row]
        residuals = np.sum((model_m - surface_m[nearest_row]) * n, axis=1)
        scale_m = max(np.sqrt(2.0) * sigma_m, 0.1 * self._surface.cell_m)
        agrees = (
            (distance_m < 2.0 * self._surface.cell_m)
            & (np.abs(residuals) < _SIGMAS * scale_m)
            & (np.sum(n * model_normals, axis=1) > 0.5)
        )
        if np.count_nonzero(agrees) < max(_MIN_AGREEING, _MIN_AGREEMENT * len(points_m)):
            raise RefusedError(
                f"{np.count_nonzero(agrees)} of {len(points_m)} points agree with the surface",
                ["not_registered"],
            )
        directions = Directions.of(model_m[agrees], n[agrees], model_normals[agrees], _MIN_INFORMATION)
        variance = max(sigma_m**2, float(np.mean(residuals[agrees] ** 2)))
        correction = directions.correction(guess, T)
        W = directions.weak
        prior = self._prior_covariance(directions)
        if len(W) and (prior is None or np.diag(W @ prior @ W.T).max() > (_WEAK * directions.radius_m) ** 2):
            raise RefusedError(
                "the surface does not constrain the pose", [f"degenerate:{n}" for n in direction_names(W)]
            )
        about_centre = directions.covariance(_INFLATION * variance) + (_COMMON * sigma_m) ** 2 * np.eye(6)
        if prior is not None:
            about_centre += W.T @ W @ prior @ W.T @ W
        self._innovations.append(directions.strong_part(correction))
        first = self._surface.capture[rows][nearest_row[agrees]]
        weights = np.bincount(first, minlength=len(self._covariances)) / len(first)
        # The surface has the errors of the poses of its captures, which its points have in common.
        shared = np.tensordot(weights, np.stack(self._covariances), axes=1)
        A = directions.to_model
        return (
            directions.moved(guess, directions.strong_part(correction)),
            A @ about_centre @ A.T + shared,
            direction_names(W) if len(W) else [],
        )

    def _prior_covariance(self, directions: Directions) -> FloatArray | None:
        """Return the covariance (6, 6) of the prediction in the coordinates of the directions; None before
        a prediction has been compared with a registration.
        """
        if len(self._poses) < _LEAST_POSES:
            return None
        A = np.linalg.inv(directions.to_model)
        squares = np.stack(self._innovations)[1:] ** 2
        return np.asarray(A @ self._covariances[-1] @ A.T + np.diag(squares.mean(axis=0)))


def _require_one_body(points_m: FloatArray) -> None:
    """Raise RefusedError if a capture (n, 3) shows several bodies."""
    link_m = _LINK_SPACINGS * spacing(kd_tree(points_m))
    parts = bodies(points_m, _DIAMETERS_PER_LINK * link_m)
    if len(parts) > 1 and len(parts[1]) >= _SECOND_BODY * len(parts[0]):
        raise RefusedError("several bodies in the first capture", [f"several_bodies:{len(parts)}"])
