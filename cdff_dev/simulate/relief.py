# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Shape of the simulated terrain: fractal relief and craters, on a grid that is fine where rovers drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.scenario import Craters, Plain, Spectrum, TerrainModel


def fractal_tile(
    rng: np.random.Generator,
    cells: int,
    cell_m: float,
    band_m: tuple[float, float],
    hurst: float,
    rms_slope: float,
) -> FloatArray:
    """Return a periodic height tile ``(cells, cells)``, metres, with power spectrum ``k^-(2H+2)`` in a band.

    Parameters
    ----------
    band_m : tuple of float
        Shortest and longest wavelength, metres.
    rms_slope : float
        Root mean square of the magnitude of the gradient, dimensionless.

    References
    ----------
    Barnsley et al. (1988), The Science of Fractal Images, ch. 2 (spectral synthesis).
    """
    k = np.fft.fftfreq(cells, cell_m)
    kx, ky = np.meshgrid(k, k)
    radial = np.hypot(kx, ky)
    inside = (radial >= 1.0 / band_m[1]) & (radial <= 1.0 / band_m[0])
    amplitude = np.zeros_like(radial)
    amplitude[inside] = radial[inside] ** -(hurst + 1.0)
    spectrum = amplitude * np.fft.fft2(rng.standard_normal((cells, cells)))
    slope_x = np.fft.ifft2(2j * math.pi * kx * spectrum).real
    slope_y = np.fft.ifft2(2j * math.pi * ky * spectrum).real
    actual = math.sqrt(float(np.mean(slope_x**2 + slope_y**2)))
    height = np.fft.ifft2(spectrum).real
    return np.asarray(height * (rms_slope / actual if actual > 0 else 0.0), dtype=np.float64)


def power_law_sizes(
    rng: np.random.Generator, count: int, low: float, high: float, slope: float
) -> FloatArray:
    """Return sizes ``(count,)`` with cumulative number ``N(>d) ~ d^-slope`` within bounds, largest first."""
    u = rng.random(count)
    sizes = (low**-slope - u * (low**-slope - high**-slope)) ** (-1.0 / slope)
    return np.asarray(np.sort(sizes)[::-1], dtype=np.float64)


def crater_profile(distance_m: FloatArray, diameter_m: float, depth_m: float, rim_m: float) -> FloatArray:
    """Return the height of a fresh simple crater at distance ``r`` from its centre, metres.

    The bowl is a parabola from ``-depth_m`` at the centre to ``rim_m`` at the radius R. Outside, the height
    of the ejecta decreases with ``(r/R)^-3`` (Pike 1977; McGetchin et al. 1973), smoothly to zero at 3 R.
    """
    x = distance_m / (0.5 * diameter_m)
    bowl = (depth_m + rim_m) * x**2 - depth_m
    ejecta = rim_m * np.maximum(x, 1.0) ** -3.0
    fade = np.clip((3.0 - x) / 1.0, 0.0, 1.0)
    return np.where(x < 1.0, bowl, ejecta * fade**2 * (3.0 - 2.0 * fade))


def graded_axis(fine_half_m: float, step_m: float, far_half_m: float, growth: float) -> FloatArray:
    """Return node coordinates, metres: steps of ``step_m`` inside ``±fine_half_m``, which grow outside.

    Outside, each step is ``growth`` times the previous one, at most 5 m, up to at least ``±far_half_m``.
    """
    cells = round(fine_half_m / step_m)
    inner = np.arange(-cells, cells + 1) * step_m
    outer, step = [float(inner[-1])], step_m
    while outer[-1] < far_half_m:
        step = min(step * growth, 5.0)
        outer.append(outer[-1] + step)
    tail = np.array(outer[1:])
    return np.concatenate([-tail[::-1], inner, tail])


@dataclass(frozen=True, slots=True, eq=False)
class Relief:
    """Heights of the terrain on a grid with variable spacing.

    Attributes
    ----------
    x_m, y_m : NDArray[np.float64], shapes (columns,), (rows,)
        Node coordinates in site, ascending.
    z_m : NDArray[np.float64], shape (rows, columns)
        Heights in site, metres.
    """

    x_m: FloatArray
    y_m: FloatArray
    z_m: FloatArray

    def height(self, xy_m: FloatArray) -> FloatArray:
        """Return heights ``(n,)``, metres, at points ``(n, 2)``, interpolated bilinearly."""
        i = np.clip(np.searchsorted(self.x_m, xy_m[:, 0], side="right") - 1, 0, len(self.x_m) - 2)
        j = np.clip(np.searchsorted(self.y_m, xy_m[:, 1], side="right") - 1, 0, len(self.y_m) - 2)
        u = (xy_m[:, 0] - self.x_m[i]) / (self.x_m[i + 1] - self.x_m[i])
        v = (xy_m[:, 1] - self.y_m[j]) / (self.y_m[j + 1] - self.y_m[j])
        z = self.z_m
        lower = z[j, i] * (1 - u) + z[j, i + 1] * u
        upper = z[j + 1, i] * (1 - u) + z[j + 1, i + 1] * u
        return np.asarray(lower * (1 - v) + upper * v, dtype=np.float64)

    def smoothed(self, sigma_cells: float) -> Relief:
        """Return a copy with heights filtered by a Gaussian, as averaged under a wheel."""
        return Relief(self.x_m, self.y_m, gaussian_filter(self.z_m, sigma_cells, mode="nearest"))

    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices ``(rows*columns, 3)``, float32, and triangles ``(m, 3)``, uint32.

        The vertices of a triangle are counter-clockwise, seen from above.
        """
        rows, columns = self.z_m.shape
        x, y = np.meshgrid(self.x_m, self.y_m)
        vertices = np.stack([x, y, self.z_m], axis=-1).reshape(-1, 3).astype(np.float32)
        index = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
        a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
        triangles = np.stack([np.stack([a, b, d], -1), np.stack([a, d, c], -1)], axis=2).reshape(-1, 3)
        return vertices, np.ascontiguousarray(triangles)


def relief_fraction(plains: Sequence[Plain], x_m: FloatArray, y_m: FloatArray) -> FloatArray:
    """Return the factor ``(rows, columns)`` of the fractal relief at nodes ``(columns,)``, ``(rows,)``."""
    fraction = np.ones((len(y_m), len(x_m)))
    for plain in plains:
        r = np.hypot(x_m[None, :] - plain.centre_xy_m[0], y_m[:, None] - plain.centre_xy_m[1])
        u = np.clip((r - plain.radius_m) / plain.margin_m, 0.0, 1.0)
        fraction *= plain.relief + (1.0 - plain.relief) * u**2 * (3.0 - 2.0 * u)
    return fraction


def _add_craters(
    rng: np.random.Generator,
    model: Craters,
    plains: Sequence[Plain],
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
) -> None:
    """Add craters to the heights ``z`` in place; none is added close to a plain."""
    sizes = power_law_sizes(rng, model.count, model.diameter_min_m, model.diameter_max_m, model.slope)
    for diameter in sizes:
        cx, cy = rng.uniform(-model.half_width_m, model.half_width_m, 2)
        depth = diameter * rng.uniform(*model.depth_ratio)
        # No large crater at the origin: a rover must not start in a bowl that it cannot leave.
        if diameter > 8.0 and math.hypot(cx, cy) < 0.5 * diameter + 9.0:
            continue
        if any(math.dist(p.centre_xy_m, (cx, cy)) < p.radius_m + 1.5 * diameter for p in plains):
            continue
        reach = 1.5 * diameter
        i0, i1 = np.searchsorted(x, [cx - reach, cx + reach])
        j0, j1 = np.searchsorted(y, [cy - reach, cy + reach])
        if i0 == i1 or j0 == j1:
            continue
        r = np.hypot(x[None, i0:i1] - cx, y[j0:j1, None] - cy)
        z[j0:j1, i0:i1] += crater_profile(r, diameter, depth, model.rim_ratio * diameter)


def make_relief(model: TerrainModel, rng: np.random.Generator) -> Relief:
    """Synthesise the terrain of a scenario; the same generator state gives the same terrain."""
    axis = graded_axis(model.fine_half_width_m, model.resolution_m, model.far_half_width_m, model.growth)
    plains = model.plains or ()
    z = _fractal(model.spectrum, model, axis, rng)
    if plains:
        z *= relief_fraction(plains, axis, axis)
    _add_craters(rng, model.craters, plains, axis, axis, z)
    return Relief(axis, axis.copy(), z)


def _fractal(
    spectrum: Spectrum, model: TerrainModel, axis: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return the fractal heights ``(n, n)`` at the nodes ``axis`` in both directions, metres."""
    coarse_cells, fine_cells = 512, 1024
    coarse_m = 2.4 * model.far_half_width_m / coarse_cells
    fine_m = model.resolution_m
    H = spectrum.hurst
    long_tile = fractal_tile(
        rng,
        coarse_cells,
        coarse_m,
        (spectrum.split_m, spectrum.longest_m),
        H,
        math.tan(math.radians(spectrum.rms_slope_deg)),
    )
    short_tile = fractal_tile(
        rng,
        fine_cells,
        fine_m,
        (spectrum.shortest_m, spectrum.split_m),
        H,
        math.tan(math.radians(spectrum.rms_slope_fine_deg)),
    )
    at = np.stack(np.meshgrid(axis, axis, indexing="ij"))
    z = map_coordinates(long_tile, at / coarse_m, order=3, mode="grid-wrap")
    # Outside the fine part the cells are too large for the short waves, which would alias: their amplitude
    # decreases to zero.
    step = np.gradient(axis)
    weight = np.clip((4.0 * fine_m - step) / (3.0 * fine_m), 0.0, 1.0)
    near = weight > 0
    block = at[:, near][:, :, near] / fine_m
    short = map_coordinates(short_tile, block, order=1, mode="grid-wrap")
    z[np.ix_(near, near)] += short * weight[near][:, None] * weight[near][None, :]
    return np.asarray(z, dtype=np.float64)
