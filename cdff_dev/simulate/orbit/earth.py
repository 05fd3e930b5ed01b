# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The Earth as a background: a generated sphere with oceans, continents, clouds and an atmosphere."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.orbit.eclipse import EARTH_RADIUS_M
from cdff_dev.simulate.orbit.materials import Float32Array

#: Rows of the map of albedo, and cells along an edge of the tile of fine clouds with its size on the ground.
_ROWS, _TILE, _TILE_M = 512, 512, 400_000.0
#: Scale height of the scattering atmosphere and its radiance at the limb, relative to a white surface.
_HAZE_M, _HAZE = 8_000.0, 0.12


@lru_cache(maxsize=2)
def earth_appearance(seed: int) -> EarthAppearance:
    """Return the Earth of a seed, which determines continents and clouds; it takes a second to generate."""
    return EarthAppearance(seed)


class EarthAppearance:
    """Albedo of the Earth."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 71])
        latitude = np.radians(90.0 - 180.0 * (np.arange(_ROWS) + 0.5) / _ROWS)
        longitude = np.radians(360.0 * (np.arange(2 * _ROWS) + 0.5) / (2 * _ROWS))
        b, a = np.meshgrid(latitude, longitude, indexing="ij")
        unit = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=-1)
        land = _sphere_noise(unit, rng, (1.5, 3.0, 6.0, 12.0))
        clouds = _sphere_noise(unit, rng, (4.0, 8.0, 16.0, 32.0))
        ground = np.where(land > 0.55, 0.22 + 0.04 * land, 0.05)
        ground = np.where(np.abs(b) > np.radians(72.0), 0.6, ground)
        cover = np.clip(0.5 * clouds + 0.35, 0.0, 1.0)
        self._ground, self._cover = ground.astype(np.float32), cover.astype(np.float32)
        k = np.hypot(*np.meshgrid(np.fft.fftfreq(_TILE), np.fft.rfftfreq(_TILE), indexing="ij"))
        spectrum = np.zeros_like(k)
        spectrum[k > 0] = k[k > 0] ** -1.6
        fine = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(_TILE, _TILE))) * spectrum)
        self._fine = (fine / fine.std()).astype(np.float32)

    def radiance(
        self,
        directions: Float32Array,
        position_m: FloatArray,
        to_sun: FloatArray,
        R_inertial_earth: FloatArray,
    ) -> Float32Array:
        """Return the radiance ``(n,)``, 1/sr, for sunlight of irradiance 1; 0 outside the Earth.

        Parameters
        ----------
        directions : ndarray float32 (n, 3)
            Unit vectors, inertial axes, as all vectors.
        position_m : ndarray (3,)
            Eye relative to the centre of the Earth.
        """
        d = directions.astype(np.float64)
        along = d @ position_m
        height2 = position_m @ position_m - along**2  # squared distance of the ray from the centre
        result = np.zeros(len(d), dtype=np.float32)
        forward = along < 0.0
        hit = np.flatnonzero(forward & (height2 < EARTH_RADIUS_M**2))
        if len(hit):
            distance = -along[hit] - np.sqrt(EARTH_RADIUS_M**2 - height2[hit])
            normal = (position_m + distance[:, None] * d[hit]) / EARTH_RADIUS_M
            cosine = normal @ to_sun
            albedo = self._albedo(normal @ R_inertial_earth)
            slant = np.clip(-np.einsum("ni,ni->n", d[hit], normal), 0.05, 1.0)
            # Haze replaces the ground towards the limb; the terminator is as wide as the twilight.
            haze = np.minimum(_HAZE / slant, 0.5)
            light = np.clip((cosine + 0.03) / 1.03, 0.0, 1.0)
            result[hit] = (light * ((1.0 - haze) * albedo + haze * 0.5) / np.pi).astype(np.float32)
        limb = np.flatnonzero(forward & (height2 >= EARTH_RADIUS_M**2))
        if len(limb):
            altitude = np.sqrt(height2[limb]) - EARTH_RADIUS_M
            near = altitude < 12.0 * _HAZE_M
            limb = limb[near]
            tangent = position_m - along[limb, None] * d[limb]
            cosine = (tangent / np.linalg.norm(tangent, axis=1, keepdims=True)) @ to_sun
            glow = 0.25 * np.exp(-altitude[near] / _HAZE_M) * np.clip(cosine + 0.05, 0.0, 1.0)
            result[limb] = (glow / np.pi).astype(np.float32)
        return result

    def _albedo(self, normal: FloatArray) -> FloatArray:
        """Return the albedo (n,) at unit vectors (n, 3) in axes of the Earth."""
        latitude = np.arcsin(np.clip(normal[:, 2], -1.0, 1.0))
        longitude = np.arctan2(normal[:, 1], normal[:, 0])
        row = (0.5 - latitude / np.pi) * _ROWS - 0.5
        column = longitude / (2.0 * np.pi) * 2 * _ROWS - 0.5
        ground, cover = _bilinear(self._ground, row, column), _bilinear(self._cover, row, column)
        scale = EARTH_RADIUS_M * _TILE / _TILE_M
        fine = _bilinear(self._fine, latitude * scale, longitude * np.cos(latitude) * scale, wrap_rows=True)
        cloud = np.clip(2.2 * (cover - 0.45) + 0.22 * fine, 0.0, 1.0)
        return np.asarray(ground * (1.0 - cloud) + 0.72 * cloud)


def _sphere_noise(unit: FloatArray, rng: np.random.Generator, wave_numbers: tuple[float, ...]) -> FloatArray:
    """Return a sum of waves in random directions with a standard deviation of about 1."""
    total = np.zeros(unit.shape[:-1])
    power = 0.0
    for k in wave_numbers:
        for _ in range(10):
            direction = rng.normal(size=3)
            direction *= k / np.linalg.norm(direction)
            total += np.sin(unit @ direction + rng.uniform(0.0, 2.0 * np.pi)) / k**0.7
            power += 0.5 / k**1.4
    return np.asarray(total / np.sqrt(power))


def _bilinear(
    image: Float32Array, row: FloatArray, column: FloatArray, wrap_rows: bool = False
) -> FloatArray:
    """Return values (n,) between the cells; columns wrap around, rows do if requested."""
    r0, c0 = np.floor(row).astype(np.int64), np.floor(column).astype(np.int64)
    fr, fc = row - r0, column - c0
    rows, columns = image.shape
    upper, lower = r0, r0 + 1
    if wrap_rows:
        upper, lower = upper % rows, lower % rows
    else:
        upper, lower = np.clip(upper, 0, rows - 1), np.clip(lower, 0, rows - 1)
    left, right = c0 % columns, (c0 + 1) % columns
    top = image[upper, left] * (1.0 - fc) + image[upper, right] * fc
    bottom = image[lower, left] * (1.0 - fc) + image[lower, right] * fc
    return np.asarray(top * (1.0 - fr) + bottom * fr)
