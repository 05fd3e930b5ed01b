# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Appearance of the simulated terrain: a texture with albedo, sun and shadows, and a periodic detail texture.

A pixel of an image then needs one ray and three texture lookups. Textures have mipmaps, which avoid aliasing
on distant terrain; ``sample`` is the trilinear lookup.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from cdff_dev.simulate.relief import Relief, fractal_tile
from cdff_dev.simulate.rocks import RockMesh
from cdff_dev.simulate.scenario import Surface, TerrainModel

Float32Array = NDArray[np.float32]

#: Period of the detail texture, texels. It is used twice, the second time scaled and rotated, so that no
#: pattern repeats visibly.
_TILE_TEXELS = 1024
#: Scale and rotation of the second use of the texture: no simple ratio, so that the patterns do not coincide.
_SECOND_TILE_SCALE = 0.731
_SECOND_TILE_ROTATION_RAD = 0.65
#: Root mean square slope of the grains in the detail texture.
_GRAIN_SLOPE = 0.16


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """A square grey texture with its mipmaps.

    Attributes
    ----------
    texels : NDArray[np.float32], shape (n,)
        Texels of all levels, finest level first, each level row by row.
    sizes : NDArray[np.int64], shape (levels,)
        Edge length of each level, texels.
    texel_m : float
        Size of a texel of the finest level.
    origin_m : float
        x and y of the outer corner of texel (0, 0); y increases with the row.
    wraps : bool
        True if the texture is periodic.
    """

    texels: Float32Array
    sizes: NDArray[np.int64]
    texel_m: float
    origin_m: float
    wraps: bool

    @classmethod
    def from_image(cls, image: Float32Array, texel_m: float, origin_m: float, wraps: bool) -> Texture:
        """Return the texture of an image ``(n, n)``.

        Each mipmap level is the 2x2 mean of the previous one.
        """
        levels = [np.asarray(image, dtype=np.float32)]
        while levels[-1].shape[0] % 2 == 0 and levels[-1].shape[0] > 8:
            n = levels[-1].shape[0] // 2
            levels.append(levels[-1].reshape(n, 2, n, 2).mean(axis=(1, 3), dtype=np.float32))
        sizes = np.array([level.shape[0] for level in levels], dtype=np.int64)
        return cls(np.concatenate([level.ravel() for level in levels]), sizes, texel_m, origin_m, wraps)


@njit(cache=True)
def _bilinear(texels, offset, n, texel_m, origin_m, wraps, x_m, y_m):  # type: ignore[no-untyped-def]
    """Return the texture at a position, interpolated between four texels of one level."""
    u = (x_m - origin_m) / texel_m - 0.5
    v = (y_m - origin_m) / texel_m - 0.5
    u0 = math.floor(u)
    v0 = math.floor(v)
    fu = u - u0
    fv = v - v0
    if wraps:
        a, b, c, d = u0 % n, (u0 + 1) % n, v0 % n, (v0 + 1) % n
    else:
        a, b = min(max(u0, 0), n - 1), min(max(u0 + 1, 0), n - 1)
        c, d = min(max(v0, 0), n - 1), min(max(v0 + 1, 0), n - 1)
    upper = texels[offset + c * n + a] * (1.0 - fu) + texels[offset + c * n + b] * fu
    lower = texels[offset + d * n + a] * (1.0 - fu) + texels[offset + d * n + b] * fu
    return upper * (1.0 - fv) + lower * fv


@njit(cache=True)
def _trilinear(texels, sizes, offsets, texel_m, origin_m, wraps, x, y, footprint_m, out):  # type: ignore[no-untyped-def]
    """Write the texture at positions, interpolated between the two levels nearest to their footprint."""
    last = sizes.size - 1
    for k in range(x.size):
        if footprint_m[k] <= texel_m:
            out[k] = _bilinear(texels, 0, sizes[0], texel_m, origin_m, wraps, x[k], y[k])
            continue
        lod = min(math.log2(footprint_m[k] / texel_m), float(last))
        i = min(int(lod), max(last - 1, 0))
        j = min(i + 1, last)
        blend = lod - i
        fine = _bilinear(texels, offsets[i], sizes[i], texel_m * (1 << i), origin_m, wraps, x[k], y[k])
        coarse = _bilinear(texels, offsets[j], sizes[j], texel_m * (1 << j), origin_m, wraps, x[k], y[k])
        out[k] = fine * (1.0 - blend) + coarse * blend


def sample(texture: Texture, x_m: Float32Array, y_m: Float32Array, footprint_m: Float32Array) -> Float32Array:
    """Return the values ``(n,)`` at points, interpolated between the mipmap levels of the pixel footprint."""
    values = np.empty(x_m.size, dtype=np.float32)
    offsets = np.concatenate([[0], np.cumsum(texture.sizes**2)])
    _trilinear(
        texture.texels,
        texture.sizes,
        offsets,
        texture.texel_m,
        texture.origin_m,
        texture.wraps,
        x_m,
        y_m,
        footprint_m,
        values,
    )
    return values


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """Radiance of the terrain and its rocks, sky and haze.

    Attributes
    ----------
    ground : Texture
        Radiance of the fine part of the ground: albedo, sun and shadows.
    detail : Texture
        Periodic factor with mean 1: grains and pebbles with their shading.
    vertex_radiance : NDArray[np.float32], shape (n,)
        Radiance at the vertices of the ground mesh, followed by those of the rock mesh.
    sky : float
        Radiance of the sky.
    haze_distance_m : float
        Distance at which the contrast has decreased to 1/e.
    """

    ground: Texture
    detail: Texture
    vertex_radiance: Float32Array
    sky: float
    haze_distance_m: float

    def detail_factor(self, x_m: Float32Array, y_m: Float32Array, footprint_m: Float32Array) -> Float32Array:
        """Return the factor ``(n,)`` at points: the product of two copies of the detail texture."""
        c, s = (
            np.float32(math.cos(_SECOND_TILE_ROTATION_RAD)),
            np.float32(math.sin(_SECOND_TILE_ROTATION_RAD)),
        )
        k = np.float32(_SECOND_TILE_SCALE)
        first = sample(self.detail, x_m, y_m, footprint_m)
        second = sample(self.detail, (c * x_m + s * y_m) * k, (c * y_m - s * x_m) * k, footprint_m * k)
        return np.asarray(first * second, dtype=np.float32)


def sun_direction(surface: Surface) -> NDArray[np.float64]:
    """Return the unit vector ``(3,)`` towards the sun in site; the azimuth is measured from x towards y."""
    e, a = math.radians(surface.sun_elevation_deg), math.radians(surface.sun_azimuth_deg)
    return np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])


def vertex_normals(vertices: Float32Array, triangles: NDArray[np.uint32]) -> Float32Array:
    """Return area-weighted unit normals ``(n, 3)`` of the vertices of a mesh."""
    p = vertices[triangles]
    face = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    normal = np.stack(
        [np.bincount(triangles.ravel(), np.repeat(face[:, a], 3), minlength=len(vertices)) for a in range(3)],
        axis=1,
    )
    return np.asarray(
        normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12), dtype=np.float32
    )


def make_appearance(
    model: TerrainModel, relief: Relief, rocks: RockMesh, scene: Any, rng: np.random.Generator
) -> Appearance:
    """Return the appearance of a terrain with rocks under the sun of the scenario.

    Parameters
    ----------
    scene : open3d.t.geometry.RaycastingScene
        Ground and rocks, for the shadows.
    """
    surface = model.surface
    assert surface is not None  # the scenario has a camera, so it has a surface
    sun = sun_direction(surface)
    ground = _bake_ground(model, relief, scene, sun, rng)
    detail = _detail_texture(surface, sun, rng)
    vertices, triangles = relief.mesh()
    normals = vertex_normals(vertices, triangles)
    ground_radiance = _lit(
        normals @ sun.astype(np.float32), sunlit(scene, vertices + 0.02 * normals, sun), surface.ambient
    )
    rock_normals = vertex_normals(rocks.vertices, rocks.triangles)
    rock_radiance = rocks.albedo * _lit(
        rock_normals @ sun.astype(np.float32),
        sunlit(scene, rocks.vertices + 0.01 * rock_normals, sun),
        surface.ambient,
    )
    vertex_radiance = np.concatenate([ground_radiance, rock_radiance]).astype(np.float32)
    return Appearance(ground, detail, vertex_radiance, 1.02, surface.haze_distance_m)


def _lit(cosine: Float32Array, sunlit: Float32Array, ambient: float) -> Float32Array:
    """Return the Lambertian radiance of a surface of albedo 1; ``sunlit`` is 0 in shadow, else 1."""
    return np.asarray(ambient + (1.0 - ambient) * np.clip(cosine, 0.0, None) * sunlit, dtype=np.float32)


def sunlit(scene: Any, points: Float32Array, sun: NDArray[np.float64]) -> Float32Array:
    """Return 1 for points ``(n, 3)`` in sunlight, 0 for those in shadow."""
    import open3d as o3d

    if len(points) == 0:
        return np.zeros(0, dtype=np.float32)
    rays = np.empty((len(points), 6), dtype=np.float32)
    rays[:, :3], rays[:, 3:] = points, sun
    hidden = scene.test_occlusions(o3d.core.Tensor.from_numpy(rays), 0.0, math.inf, 1)
    return np.asarray(1.0 - hidden.numpy().astype(np.float32))


def _bake_ground(
    model: TerrainModel, relief: Relief, scene: Any, sun: NDArray[np.float64], rng: np.random.Generator
) -> Texture:
    """Return the texture of the fine part of the ground: albedo, sun and shadows."""
    surface = model.surface
    assert surface is not None  # checked by the caller
    half = model.fine_half_width_m
    n = int(2 ** round(math.log2(2 * half / surface.texel_m)))
    texel = 2 * half / n
    axis = (np.arange(n) + 0.5) * texel - half
    x, y = np.meshgrid(axis, axis)
    z = relief.height(np.stack([x.ravel(), y.ravel()], axis=1)).reshape(n, n)
    gy, gx = np.gradient(z, texel)
    cosine = (sun[2] - gx * sun[0] - gy * sun[1]) / np.sqrt(1 + gx**2 + gy**2)
    points = np.stack([x.ravel(), y.ravel(), z.ravel() + 0.01], axis=1).astype(np.float32)
    light = gaussian_filter(sunlit(scene, points, sun).reshape(n, n), 0.8, mode="nearest")
    patches = fractal_tile(rng, n, texel, (4 * texel, 0.6 * half), 0.25, 1.0)
    patches /= max(float(np.std(patches)), 1e-12)
    albedo = np.clip(1.0 + surface.albedo_contrast * patches, 0.35, 1.8)
    return Texture.from_image(
        (albedo * _lit(cosine.astype(np.float32), light, surface.ambient)).astype(np.float32),
        texel,
        -half,
        wraps=False,
    )


def _detail_texture(surface: Surface, sun: NDArray[np.float64], rng: np.random.Generator) -> Texture:
    """Return the periodic texture of grains and pebbles."""
    n, texel = _TILE_TEXELS, surface.detail_texel_m
    grain = fractal_tile(rng, n, texel, (2.5 * texel, 0.5), 0.1, 1.0)
    grain /= np.std(grain)
    height = fractal_tile(rng, n, texel, (3 * texel, 0.4), 0.5, _GRAIN_SLOPE)
    pebble_albedo = np.zeros((n, n))
    for _ in range(rng.poisson(surface.pebbles_per_m2 * (n * texel) ** 2)):
        radius = min(0.006 * rng.pareto(2.2) + 0.006, 0.035)
        ci, cj = rng.integers(0, n, 2)
        reach = math.ceil(1.2 * radius / texel)
        span = np.arange(-reach, reach + 1)
        aspect, angle = rng.uniform(0.6, 1.0), rng.uniform(0, math.pi)
        jj, ii = np.meshgrid(span * texel, span * texel)
        a = jj * math.cos(angle) + ii * math.sin(angle)
        b = (ii * math.cos(angle) - jj * math.sin(angle)) / aspect
        dome = np.clip(1.0 - (a**2 + b**2) / radius**2, 0.0, None)
        rows, columns = (ci + span) % n, (cj + span) % n
        height[np.ix_(rows, columns)] += 0.7 * radius * np.sqrt(dome)
        pebble_albedo[np.ix_(rows, columns)] += (dome > 0) * rng.normal(0.0, 0.16)
    gy = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) / (2 * texel)
    gx = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) / (2 * texel)
    shade = (sun[2] - gx * sun[0] - gy * sun[1]) / np.sqrt(1 + gx**2 + gy**2) / sun[2]
    image = (1.0 + surface.detail_contrast * grain + pebble_albedo) * (0.25 + 0.75 * np.clip(shade, 0.0, 2.2))
    image = np.clip(image, 0.15, 2.5)
    return Texture.from_image((image / image.mean()).astype(np.float32), texel, 0.0, wraps=True)
