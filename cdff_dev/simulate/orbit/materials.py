# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reflectance of surfaces: diffuse, glossy with a microfacet distribution, and regolith.

References
----------
.. [1] Walter, B. et al. (2007). Microfacet models for refraction through rough surfaces. EGSR.
   doi:10.2312/EGWR/EGSR07/195-206 (distribution GGX)
.. [2] Schlick, C. (1994). An inexpensive BRDF model for physically-based rendering.
   doi:10.1111/1467-8659.1330233
.. [3] Hapke, B. (2012). Theory of Reflectance and Emittance Spectroscopy, §8.7 (Lommel-Seeliger law).
   doi:10.1017/CBO9781139025683
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.interfaces.dfn import StrictModel
from cdff_dev.simulate.fields import NotNegative

Float32Array = NDArray[np.float32]


class Material(StrictModel):
    """Reflectance of one material.

    ``law`` regolith is that of Lommel and Seeliger, with ``albedo`` as the albedo of single scattering.
    Crinkles tilt the normals of foil. Cells are the grid of a solar panel, whose lines are diffuse.
    """

    law: Literal["glossy", "regolith"] = "glossy"
    albedo: Annotated[float, Field(ge=0, le=1, description="diffuse")] = 0.5
    specular: Annotated[float, Field(ge=0, le=1, description="reflectance at normal incidence")] = 0.0
    roughness: Annotated[float, Field(ge=0.02, le=1, description="width of the distribution GGX")] = 0.5
    crinkle_rad: Annotated[float, Field(ge=0, le=0.7, description="rms tilt of the normals")] = 0.0
    crinkle_m: Annotated[float, Field(gt=0, description="size of crinkles")] = 0.06
    cell_m: Annotated[float | None, Field(gt=0, description="distance of the lines of a grid")] = None
    line_m: NotNegative = 0.0
    line_albedo: Annotated[float, Field(ge=0, le=1)] = 0.6


MATERIALS = {
    "paint_white": Material(albedo=0.8, specular=0.03, roughness=0.4),
    "paint_grey": Material(albedo=0.35, specular=0.03, roughness=0.4),
    "paint_black": Material(albedo=0.04, specular=0.03, roughness=0.3),
    "foil_gold": Material(albedo=0.12, specular=0.55, roughness=0.16, crinkle_rad=0.16),
    "foil_silver": Material(albedo=0.15, specular=0.75, roughness=0.14, crinkle_rad=0.14),
    "solar_cell": Material(albedo=0.03, specular=0.06, roughness=0.06, cell_m=0.08, line_m=0.004),
    "metal": Material(albedo=0.2, specular=0.6, roughness=0.25),
    "regolith": Material(law="regolith", albedo=0.12),
}


@dataclass(frozen=True, slots=True, eq=False)
class MaterialTable:
    """Columns ``(k,)`` of the values of k materials."""

    is_regolith: NDArray[np.bool_]
    albedo: Float32Array
    specular: Float32Array
    roughness: Float32Array
    crinkle_rad: Float32Array
    crinkle_m: Float32Array
    cell_m: Float32Array
    line_m: Float32Array
    line_albedo: Float32Array

    @classmethod
    def of(cls, materials: tuple[Material, ...]) -> MaterialTable:
        """Return the table; a material without cells has infinitely large ones."""

        def column(name: str) -> Float32Array:
            values = [getattr(m, name) for m in materials]
            return np.array([np.inf if v is None else v for v in values], dtype=np.float32)

        names = (
            "albedo",
            "specular",
            "roughness",
            "crinkle_rad",
            "crinkle_m",
            "cell_m",
            "line_m",
            "line_albedo",
        )
        return cls(np.array([m.law == "regolith" for m in materials]), *(column(name) for name in names))


def tilted(
    table: MaterialTable, material: NDArray[np.intp], points_m: Float32Array, normals: Float32Array
) -> Float32Array:
    """Return unit normals ``(n, 3)`` at points ``(n, 3)``, body axes, tilted by the crinkles of foil."""
    amount = table.crinkle_rad[material]
    crinkled = np.flatnonzero(amount)
    if not len(crinkled):
        return normals
    scaled = points_m[crinkled] * (np.float32(2.0 * np.pi) / table.crinkle_m[material[crinkled], None])
    tilt = np.zeros_like(scaled)
    for direction, wave, phase in zip(*_WAVES, strict=True):
        tilt += direction * np.sin(scaled @ wave + phase)[:, None]
    bent = normals[crinkled] + amount[crinkled, None] * tilt
    result = normals.copy()
    result[crinkled] = bent / np.linalg.norm(bent, axis=1, keepdims=True)
    return result


def _waves() -> tuple[Float32Array, Float32Array, Float32Array]:
    """Return directions (k, 3), wave vectors (k, 3) and phases (k,) whose sum has an rms of 1 per axis."""
    rng = np.random.default_rng(97)
    n = 9
    waves = rng.normal(size=(n, 3))
    waves *= (rng.uniform(0.5, 1.6, n) / np.linalg.norm(waves, axis=1))[:, None]
    directions = rng.normal(size=(n, 3))
    directions *= np.sqrt(6.0 / n) / np.linalg.norm(directions, axis=1)[:, None]
    return (
        directions.astype(np.float32),
        waves.astype(np.float32),
        rng.uniform(0.0, 2.0 * np.pi, n).astype(np.float32),
    )


_WAVES = _waves()


def reflected(
    table: MaterialTable,
    material: NDArray[np.intp],
    points_m: Float32Array,
    normals: Float32Array,
    to_light: Float32Array,
    to_eye: Float32Array,
) -> Float32Array:
    """Return the radiance ``(n,)``, 1/sr, for a light of irradiance 1 on a surface at right angles to it.

    Parameters
    ----------
    material : ndarray (n,)
        Rows of the table.
    points_m, normals, to_eye : ndarray float32 (n, 3)
        Points and unit vectors in body axes; normals on the side of the eye.
    to_light : ndarray float32 (n, 3) or (3,)
        Unit vectors.
    """
    light = np.broadcast_to(to_light, normals.shape)
    cos_i = np.maximum(np.einsum("ni,ni->n", normals, light), 0.0)
    cos_o = np.maximum(np.einsum("ni,ni->n", normals, to_eye), 1e-3)
    regolith = table.is_regolith[material]
    albedo = _albedo(table, material, points_m)
    result = albedo * cos_i * np.float32(1.0 / np.pi)
    if regolith.any():
        k = np.flatnonzero(regolith & (cos_i > 0.0))
        result[k] = albedo[k] * cos_i[k] / (cos_i[k] + cos_o[k]) * np.float32(0.25 / np.pi)
    k = np.flatnonzero((table.specular[material] > 0.0) & ~regolith & (cos_i > 0.0))
    if len(k):
        result[k] += _gloss(table, material[k], normals[k], light[k], to_eye[k], cos_i[k], cos_o[k])
    return np.asarray(result, dtype=np.float32)


def _albedo(table: MaterialTable, material: NDArray[np.intp], points_m: Float32Array) -> Float32Array:
    """Return the diffuse albedo ``(n,)``, with the lines of solar cells."""
    albedo = table.albedo[material]
    k = np.flatnonzero(np.isfinite(table.cell_m[material]))
    if len(k):
        cell = table.cell_m[material[k], None]
        # Solar panels lie in planes of constant z of the body.
        offset = np.abs(points_m[k] - np.rint(points_m[k] / cell) * cell)
        near = (offset < 0.5 * table.line_m[material[k], None])[:, :2].any(axis=1)
        albedo[k] = np.where(near, table.line_albedo[material[k]], albedo[k])
    return np.asarray(albedo)


def _gloss(
    table: MaterialTable,
    material: NDArray[np.intp],
    normals: Float32Array,
    light: Float32Array,
    eye: Float32Array,
    cos_i: Float32Array,
    cos_o: Float32Array,
) -> Float32Array:
    """Return the glossy part ``(n,)`` of the radiance: GGX, height-correlated shadowing, Schlick."""
    half = light + eye
    half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-6)
    cos_h = np.clip(np.einsum("ni,ni->n", normals, half), 0.0, 1.0)
    a2 = table.roughness[material] ** 2
    distribution = a2 / (np.pi * (cos_h**2 * (a2 - 1.0) + 1.0) ** 2)
    shadowing = 0.5 / (
        cos_o * np.sqrt(cos_i**2 * (1.0 - a2) + a2) + cos_i * np.sqrt(cos_o**2 * (1.0 - a2) + a2)
    )
    base = table.specular[material]
    grazing = (1.0 - np.clip(np.einsum("ni,ni->n", half, eye), 0.0, 1.0)) ** 5
    fresnel = base + (1.0 - base) * grazing
    return np.asarray(distribution * shadowing * fresnel * cos_i, dtype=np.float32)
