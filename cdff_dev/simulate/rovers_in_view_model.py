# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Section ``rovers_in_view`` of a scenario: shape of the rovers and the dust that they raise."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import StrictModel
from cdff_dev.simulate.fields import NotNegative, Positive, Vector3

#: Number of corners of the polygon that approximates a wheel.
_WHEEL_EDGES = 14


class RoverPart(StrictModel):
    """A box of the body of a rover, parallel to the axes of its base."""

    centre_m: Annotated[Vector3, Field(description="centre in the base, m")]
    size_m: Annotated[tuple[Positive, Positive, Positive], Field(description="length, width, height, m")]
    albedo: Annotated[float, Field(gt=0, le=2, description="relative to the mean of the ground")]


class RoverWheels(StrictModel):
    """Wheels in two rows."""

    radius_m: Positive
    width_m: Positive
    x_m: Annotated[tuple[float, ...], Field(min_length=1, description="axles in the base, m")]
    y_m: Annotated[float, Field(gt=0, description="distance of the rows from the middle, m")]
    axle_height_m: Annotated[float, Field(description="height of the axles in the base, m")]
    albedo: Annotated[float, Field(gt=0, le=2, description="relative to the mean of the ground")]


class RaisedDust(StrictModel):
    """Clouds behind a rover that moves: each grows, thins and moves with the wind.

    Source: Gaussian puffs, Hanna, Briggs, Hosker (1982), Handbook on atmospheric diffusion, chapter 6.
    """

    optical_depth: Annotated[NotNegative, Field(description="through the middle of a new cloud")]
    radius_m: Annotated[Positive, Field(description="standard deviation of a new cloud, m")]
    growth_m_s: NotNegative
    life_s: Annotated[Positive, Field(description="time after which a cloud has 1/e of its dust, s")]
    period_s: Annotated[Positive, Field(description="time between clouds, s")]
    wind_m_s: tuple[float, float] = (0.0, 0.0)


class RoversInView(StrictModel):
    """Bodies of all rovers of a scenario, as the cameras of the others see them."""

    parts: Annotated[tuple[RoverPart, ...], Field(min_length=1)]
    wheels: RoverWheels | None = None
    dust: RaisedDust | None = None

    @property
    def height_m(self) -> float:
        """Height from the lowest to the highest point."""
        vertices, _, _ = body_mesh(self)
        return float(np.ptp(vertices[:, 2]))


def body_mesh(model: RoversInView) -> tuple[FloatArray, NDArray[np.uint32], FloatArray]:
    """Return vertices ``(n, 3)`` in the base, triangles ``(m, 3)`` and the albedo ``(m,)`` of each."""
    vertices, triangles, albedo = [], [], []
    count = 0
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2.0
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    for part in model.parts:
        vertices.append(np.array(part.centre_m) + corners * np.array(part.size_m))
        triangles.append(faces + count)
        albedo.append(np.full(len(faces), part.albedo))
        count += len(corners)
    if (w := model.wheels) is not None:
        angle = 2.0 * math.pi * np.arange(_WHEEL_EDGES) / _WHEEL_EDGES
        ring = w.radius_m * np.column_stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)])
        half = np.array([0.0, 0.5 * w.width_m, 0.0])
        k = np.arange(_WHEEL_EDGES)
        after = (k + 1) % _WHEEL_EDGES
        n = _WHEEL_EDGES
        wheel = np.concatenate(
            [
                np.column_stack([k, after, after + n]),
                np.column_stack([k, after + n, k + n]),
                np.column_stack([np.full(n - 2, 0), after[1:-1], k[1:-1]]),
                np.column_stack([np.full(n - 2, n), k[1:-1] + n, after[1:-1] + n]),
            ]
        )
        for x in w.x_m:
            for y in (-w.y_m, w.y_m):
                centre = np.array([x, y, w.axle_height_m])
                vertices.append(np.concatenate([centre + ring - half, centre + ring + half]))
                triangles.append(wheel + count)
                albedo.append(np.full(len(wheel), w.albedo))
                count += 2 * n
    return np.concatenate(vertices), np.concatenate(triangles).astype(np.uint32), np.concatenate(albedo)
