# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Solids that are no terrain: parts of the rover's own body, and objects that move. All are boxes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.ndimage import map_coordinates

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import StrictModel
from cdff_dev.simulate.fields import Mount, NotNegative, Positive, Vector3

#: Cell size of the texture of solids, metres, and the texture, values from -1 to 1.
_TEXEL_M = 0.03
_TEXTURE = np.random.default_rng(0).uniform(-1.0, 1.0, (64, 64))
#: Shortest distance at which a ray hits a solid, metres: a ray that starts on a solid does not hit it.
_CLEARANCE_M = 1e-4


class Ground(Protocol):
    """The shape of the terrain."""

    def height(self, xy_m: FloatArray) -> FloatArray:
        """Return heights ``(n,)``, metres, at points ``(n, 2)``."""


class Box(StrictModel):
    """Size and appearance of a box."""

    size_m: Annotated[tuple[Positive, Positive, Positive], Field(description="length, width and height, m")]
    albedo: Annotated[float, Field(gt=0, le=2, description="relative to the mean of the ground")] = 0.6
    contrast: Annotated[float, Field(ge=0, le=1, description="of the texture, relative")] = 0.4


class BodyPart(Box):
    """A part of the rover that its own sensors see: an arm, a panel, a mast.

    Source: geometry; each ray and each ray towards the sun is intersected with the box.
    """

    mount: Annotated[Mount, Field(description="pose of the centre of the box in the base")]
    swing_deg: Annotated[
        float, Field(ge=0, le=90, description="amplitude of the rotation about the pivot, °")
    ] = 0.0
    swing_period_s: Annotated[float, Field(gt=0, description="period of the rotation, s")] = 10.0
    pivot_m: Annotated[
        Vector3, Field(description="point in the base on the vertical axis of rotation, m")
    ] = (
        0.0,
        0.0,
        0.0,
    )


class MovingObject(Box):
    """A box that stands on the ground and moves with constant velocity.

    Source: geometry; each ray is intersected with the box at the time of the ray.
    """

    start_xy_m: Annotated[tuple[float, float], Field(description="position in site until the start, m")]
    velocity_m_s: Annotated[tuple[float, float], Field(description="velocity in site after the start, m/s")]
    start_s: Annotated[NotNegative, Field(description="time of the start, s since the epoch")] = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A box with its poses at several times.

    Attributes
    ----------
    poses : NDArray[np.float64], shape (g, 4, 4)
        ``T_site_box``, one for each group of rays.
    velocity_m_s : NDArray[np.float64], shape (g, 3)
        Velocity in site; not used for parts of the rover.
    on_rover : bool
        True if the solid is a part of the rover.
    """

    box: Box
    poses: FloatArray
    velocity_m_s: FloatArray
    on_rover: bool


@dataclass(frozen=True, slots=True, eq=False)
class SolidHits:
    """First solid that each ray hits, for ``g`` groups of ``k`` rays.

    Attributes
    ----------
    t : NDArray[np.float64], shape (g, k)
        Ray parameter of the hit, in lengths of the direction; infinite where a ray hits no solid.
    normals : NDArray[np.float64], shape (g, k, 3)
        Outward normals in site.
    albedo : NDArray[np.float64], shape (g, k)
    velocity_m_s : NDArray[np.float64], shape (g, k, 3)
    on_rover : NDArray[np.bool_], shape (g, k)
    """

    t: FloatArray
    normals: FloatArray
    albedo: FloatArray
    velocity_m_s: FloatArray
    on_rover: NDArray[np.bool_]


def body_solids(parts: Sequence[BodyPart], T_site_base: FloatArray, t_s: FloatArray) -> list[Solid]:
    """Return the parts of a rover at poses ``(g, 4, 4)`` and times ``(g,)``."""
    solids = []
    for part in parts:
        angle = math.radians(part.swing_deg) * np.sin(2.0 * math.pi * t_s / part.swing_period_s)
        R = np.array([se3.exp_so3([0.0, 0.0, a]) for a in angle])
        pivot = np.array(part.pivot_m)
        swing = se3.transform(R, pivot - R @ pivot)
        poses = T_site_base @ swing @ part.mount.matrix()
        solids.append(Solid(part, poses, np.zeros((len(t_s), 3)), on_rover=True))
    return solids


def object_solids(objects: Sequence[MovingObject], ground: Ground, t_s: FloatArray) -> list[Solid]:
    """Return the moving objects on the ground at times ``(g,)``."""
    solids = []
    for moving_object in objects:
        velocity = np.array(moving_object.velocity_m_s)
        xy = (
            np.array(moving_object.start_xy_m)
            + np.maximum(t_s - moving_object.start_s, 0.0)[:, None] * velocity
        )
        z = ground.height(xy) + 0.5 * moving_object.size_m[2]
        R = se3.exp_so3([0.0, 0.0, math.atan2(velocity[1], velocity[0])])
        poses = se3.transform(np.tile(R, (len(t_s), 1, 1)), np.column_stack([xy, z]))
        moves = (t_s >= moving_object.start_s)[:, None] * np.array([*velocity, 0.0])
        solids.append(Solid(moving_object, poses, moves, on_rover=False))
    return solids


def cast(solids: Sequence[Solid], origins: FloatArray, directions: FloatArray) -> SolidHits:
    """Return the first hits of rays ``(g, k, 3)``; origins may have the shape ``(g, 1, 3)``.

    References
    ----------
    Kay, Kajiya (1986), Ray tracing complex scenes, SIGGRAPH (slab method).
    """
    shape = directions.shape[:2]
    t = np.full(shape, np.inf)
    normals, velocity = np.zeros((*shape, 3)), np.zeros((*shape, 3))
    albedo, on_rover = np.zeros(shape), np.zeros(shape, dtype=bool)
    for solid in solids:
        group, ray = _close_rays(solid, origins, directions)
        R, centre = solid.poses[group, :3, :3], solid.poses[group, :3, 3]
        half = 0.5 * np.array(solid.box.size_m)
        o = np.einsum("nij,ni->nj", R, origins[group, ray if origins.shape[1] > 1 else 0] - centre)
        d = np.einsum("nij,ni->nj", R, directions[group, ray])
        d = np.where(np.abs(d) < 1e-12, 1e-12, d)
        near, far = (-np.copysign(half, d) - o) / d, (np.copysign(half, d) - o) / d
        entry = near.max(axis=1)
        hit = (entry < far.min(axis=1)) & (entry > _CLEARANCE_M) & (entry < t[group, ray])
        axis = near[hit].argmax(axis=1)
        sign = -np.sign(np.take_along_axis(d[hit], axis[:, None], axis=1))
        at = group[hit], ray[hit]
        t[at] = entry[hit]
        normals[at] = sign * np.take_along_axis(R[hit], axis[:, None, None], axis=2)[:, :, 0]
        texture = _texture(o[hit] + entry[hit, None] * d[hit], axis)
        albedo[at] = solid.box.albedo * (1.0 + solid.box.contrast * texture)
        velocity[at] = solid.velocity_m_s[group[hit]]
        on_rover[at] = solid.on_rover
    return SolidHits(t, normals, albedo, velocity, on_rover)


def _close_rays(
    solid: Solid, origins: FloatArray, directions: FloatArray
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return group and index of the rays whose lines meet the sphere around a solid."""
    to_centre = solid.poses[:, None, :3, 3] - origins
    along = np.einsum("gki,gki->gk", np.broadcast_to(to_centre, directions.shape), directions)
    length = np.einsum("gki,gki->gk", directions, directions)
    distance = np.einsum("gki,gki->gk", to_centre, to_centre)
    squared_radius = 0.25 * float(np.sum(np.square(solid.box.size_m)))
    group, ray = np.nonzero(distance - along**2 / length <= squared_radius)
    return group, ray


def _texture(local_m: FloatArray, axis: NDArray[np.intp]) -> FloatArray:
    """Return the texture ``(n,)`` at points ``(n, 3)`` on the faces with normals along ``axis``."""
    u = np.take_along_axis(local_m, ((axis + 1) % 3)[:, None], axis=1)[:, 0]
    v = np.take_along_axis(local_m, ((axis + 2) % 3)[:, None], axis=1)[:, 0]
    at = np.stack([u / _TEXEL_M + 17.0 * axis, v / _TEXEL_M])
    return np.asarray(map_coordinates(_TEXTURE, at, order=1, mode="grid-wrap"))
