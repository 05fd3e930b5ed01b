# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sub-pixel alignment of small patches for trackers and stereo matchers, compiled by numba.

Patches are compared by zero-mean normalised cross-correlation and aligned after removing their mean and gain,
so that exposure and vignetting do not shift the result.

References
----------
.. [1] S. Baker, I. Matthews, Lucas-Kanade 20 Years On, IJCV 56(3), 2004,
  doi:10.1023/B:VISI.0000011205.11775.fd
"""

from __future__ import annotations

import numba as nb
import numpy as np

_FLAT = 1e-3  # sum of squared grey-level deviations below which a patch has no structure
_MAX_SLOPE_STEP = 0.5
_SLOPE_DAMPING = 0.05  # fraction of the information on a translation; limits steps of an unobservable slope
_MAX_STEP_PX = 2.0  # the linearisation is invalid for longer steps


@nb.njit(cache=True, inline="always")
def _bilinear(image, x, y):  # type: ignore[no-untyped-def]
    column, row = int(x), int(y)
    a, b = x - column, y - row
    top = (1.0 - a) * image[row, column] + a * image[row, column + 1]
    bottom = (1.0 - a) * image[row + 1, column] + a * image[row + 1, column + 1]
    return (1.0 - b) * top + b * bottom


@nb.njit(cache=True, fastmath={"reassoc", "contract", "arcp", "nsz"})
def align_patches(reference, image, points, start, warps, half, iterations, tolerance_px):  # type: ignore[no-untyped-def]
    """Locate patches around ``points`` of ``reference`` in ``image`` by inverse-compositional Gauss-Newton
    [1]_.

    Parameters
    ----------
    reference, image : Float32Array, shape (rows, cols)
    points : FloatArray, shape (n, 2)
        Patch centres x, y in ``reference``, pixels.
    start : FloatArray, shape (n, 2)
        Initial positions in ``image``, pixels.
    warps : FloatArray, shape (n, 3, 3)
        Homographies from offsets around the point in ``reference`` to offsets in ``image``: last column ``0,
        0, 1``.
    half : int
        Patches are ``2 half + 1`` pixels wide.
    iterations : int
    tolerance_px : float
        The search ends at a step below this.

    Returns
    -------
    positions : FloatArray, shape (n, 2)
        Final positions, pixels.
    score : FloatArray, shape (n,)
        Normalised cross-correlation there; -1 if the patch left the image, is flat, or the search did not
        converge.
    """
    n = len(points)
    positions, score = start.copy(), np.full(n, -1.0)
    width = 2 * half + 1
    m = width * width
    T, gx, gy, patch = np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    block = np.empty((width + 2, width + 2))
    for i in range(n):
        px, py = points[i, 0], points[i, 1]
        axx, axy, ayx, ayy = warps[i, 0, 0], warps[i, 0, 1], warps[i, 1, 0], warps[i, 1, 1]
        wx, wy = warps[i, 2, 0], warps[i, 2, 1]
        margin = half + 2.0
        if not (
            margin <= px < reference.shape[1] - margin - 1 and margin <= py < reference.shape[0] - margin - 1
        ):
            continue
        for v in range(width + 2):
            for u in range(width + 2):
                block[v, u] = _bilinear(reference, px + (u - half - 1), py + (v - half - 1))
        mean, mean_x, mean_y, k = 0.0, 0.0, 0.0, 0
        for v in range(1, width + 1):
            for u in range(1, width + 1):
                T[k] = block[v, u]
                gx[k] = 0.5 * (block[v, u + 1] - block[v, u - 1])
                gy[k] = 0.5 * (block[v + 1, u] - block[v - 1, u])
                mean += T[k]
                mean_x += gx[k]
                mean_y += gy[k]
                k += 1
        mean, mean_x, mean_y = mean / m, mean_x / m, mean_y / m
        energy, hxx, hxy, hyy = 0.0, 0.0, 0.0, 0.0
        for k in range(m):
            T[k] -= mean
            gx[k] -= mean_x
            gy[k] -= mean_y
            energy += T[k] * T[k]
            hxx += gx[k] * gx[k]
            hxy += gx[k] * gy[k]
            hyy += gy[k] * gy[k]
        determinant = hxx * hyy - hxy * hxy
        if energy < _FLAT or determinant <= 1e-6 * (hxx + hyy) ** 2:
            continue
        x, y, converged = start[i, 0], start[i, 1], False
        min_depth = 1.0 - half * (abs(wx) + abs(wy))
        if min_depth < 0.5:
            continue
        extent = half * max(abs(axx) + abs(axy), abs(ayx) + abs(ayy)) / min_depth + 2.0
        for _ in range(iterations + 1):
            if not (extent <= x < image.shape[1] - extent - 1 and extent <= y < image.shape[0] - extent - 1):
                converged = False
                break
            patch_mean, k = 0.0, 0
            for v in range(-half, half + 1):
                for u in range(-half, half + 1):
                    scale = 1.0 / (1.0 + wx * u + wy * v)
                    patch[k] = _bilinear(
                        image, x + scale * (axx * u + axy * v), y + scale * (ayx * u + ayy * v)
                    )
                    patch_mean += patch[k]
                    k += 1
            patch_mean /= m
            cross, patch_energy = 0.0, 0.0
            for k in range(m):
                patch[k] -= patch_mean
                cross += patch[k] * T[k]
                patch_energy += patch[k] * patch[k]
            if patch_energy < _FLAT or cross <= 0.0:
                converged = False
                break
            score[i] = cross / np.sqrt(patch_energy * energy)
            if converged:
                break
            gain = energy / cross
            bx, by = 0.0, 0.0
            for k in range(m):
                e = patch[k] * gain - T[k]
                bx += gx[k] * e
                by += gy[k] * e
            dx, dy = (hyy * bx - hxy * by) / determinant, (hxx * by - hxy * bx) / determinant
            length = np.sqrt(dx * dx + dy * dy)
            if length > _MAX_STEP_PX:
                dx, dy = dx * _MAX_STEP_PX / length, dy * _MAX_STEP_PX / length
            x, y = x - axx * dx - axy * dy, y - ayx * dx - ayy * dy
            converged = length < tolerance_px
        if not converged:
            score[i] = -1.0
        positions[i, 0], positions[i, 1] = x, y
    return positions, score


@nb.njit(cache=True, fastmath={"reassoc", "contract", "arcp", "nsz"})
def align_slanted(left, right, points, start, half, iterations, tolerance_px, max_slope):  # type: ignore[no-untyped-def]
    """Align patches of the left image of a rectified pair in the right one, with the slope of the disparity.

    The pixel ``(u, v)`` from the centre of a patch lies at ``(x + u - a u - b v, y + v)``: a plane in space
    is a plane in disparity, and on the ground ahead the disparity changes by ``b = baseline / height``
    from row to row, by pixels over a patch. Without the slope, such a patch would be matched at its strongest
    texture.

    Parameters
    ----------
    left, right : Float32Array, shape (rows, cols)
    points, start : FloatArray, shape (n, 2)
        Patch centres in ``left`` and initial positions in ``right``, pixels.
    half, iterations, tolerance_px
        As in ``align_patches``.
    max_slope : float
        The search fails at a slope beyond this.

    Returns
    -------
    positions : FloatArray, shape (n, 2)
    slopes : FloatArray, shape (n, 2)
        ``a, b``: derivatives of the disparity by column and row.
    score : FloatArray, shape (n,)
        As in ``align_patches``.
    """
    n = len(points)
    positions, slopes, score = start.copy(), np.zeros((n, 2)), np.full(n, -1.0)
    width = 2 * half + 1
    m = width * width
    T, patch, G = np.empty(m), np.empty(m), np.empty((4, m))
    block = np.empty((width + 2, width + 2))
    H, rhs = np.empty((4, 4)), np.empty(4)
    for i in range(n):
        px, py = points[i, 0], points[i, 1]
        margin = half + 2.0
        if not (margin <= px < left.shape[1] - margin - 1 and margin <= py < left.shape[0] - margin - 1):
            continue
        for v in range(width + 2):
            for u in range(width + 2):
                block[v, u] = _bilinear(left, px + (u - half - 1), py + (v - half - 1))
        k = 0
        for v in range(1, width + 1):
            for u in range(1, width + 1):
                T[k] = block[v, u]
                gx = 0.5 * (block[v, u + 1] - block[v, u - 1])
                G[0, k] = gx
                G[1, k] = 0.5 * (block[v + 1, u] - block[v - 1, u])
                G[2, k] = gx * (u - half - 1) / half
                G[3, k] = gx * (v - half - 1) / half
                k += 1
        T -= T.mean()
        energy = 0.0
        for k in range(m):
            energy += T[k] * T[k]
        for j in range(4):
            G[j] -= G[j].mean()
        for j in range(4):
            for i2 in range(j + 1):
                total = 0.0
                for k in range(m):
                    total += G[j, k] * G[i2, k]
                H[j, i2] = H[i2, j] = total
        if energy < _FLAT or H[0, 0] * H[1, 1] - H[0, 1] ** 2 <= 1e-6 * (H[0, 0] + H[1, 1]) ** 2:
            continue
        for j in range(2, 4):
            H[j, j] += _SLOPE_DAMPING * H[0, 0]
        inverse = np.linalg.inv(H)
        x, y, a, b, converged = start[i, 0], start[i, 1], 0.0, 0.0, False
        for _ in range(iterations + 1):
            extent_x, extent_y = half * (abs(1.0 - a) + abs(b)) + 2.0, half + 2.0
            if not (
                extent_x <= x < right.shape[1] - extent_x - 1
                and extent_y <= y < right.shape[0] - extent_y - 1
            ):
                converged = False
                break
            patch_mean, k = 0.0, 0
            for v in range(-half, half + 1):
                for u in range(-half, half + 1):
                    patch[k] = _bilinear(right, x + (1.0 - a) * u - b * v, y + v)
                    patch_mean += patch[k]
                    k += 1
            patch_mean /= m
            cross, patch_energy = 0.0, 0.0
            for k in range(m):
                patch[k] -= patch_mean
                cross += patch[k] * T[k]
                patch_energy += patch[k] * patch[k]
            if patch_energy < _FLAT or cross <= 0.0:
                converged = False
                break
            score[i] = cross / np.sqrt(patch_energy * energy)
            if converged:
                break
            gain = energy / cross
            for j in range(4):
                total = 0.0
                for k in range(m):
                    total += G[j, k] * (patch[k] * gain - T[k])
                rhs[j] = total
            dx, dy, da, db = 0.0, 0.0, 0.0, 0.0
            for j in range(4):
                dx += inverse[0, j] * rhs[j]
                dy += inverse[1, j] * rhs[j]
                da += inverse[2, j] * rhs[j] / half
                db += inverse[3, j] * rhs[j] / half
            length = np.sqrt(dx * dx + dy * dy)
            excess = max(length / _MAX_STEP_PX, abs(da) / _MAX_SLOPE_STEP, abs(db) / _MAX_SLOPE_STEP)
            if excess > 1.0:
                dx, dy, da, db = dx / excess, dy / excess, da / excess, db / excess
            # The warp [[1 - a, -b], [0, 1]] times the inverse of the step's, [[1 + da, db], [0, 1]].
            along = (1.0 - a) / (1.0 + da)
            across = -b - along * db
            x, y = x - along * dx - across * dy, y - dy
            a, b = 1.0 - along, -across
            if abs(a) > max_slope or abs(b) > max_slope:
                converged = False
                break
            converged = length < tolerance_px and half * (abs(da) + abs(db)) < 4.0 * tolerance_px
        if not converged:
            score[i] = -1.0
        positions[i, 0], positions[i, 1], slopes[i, 0], slopes[i, 1] = x, y, a, b
    return positions, slopes, score


@nb.njit(cache=True, fastmath={"reassoc", "contract", "arcp", "nsz"})
def search_rows(left, right, points, lowest, highest, half):  # type: ignore[no-untyped-def]
    """Search each point of ``left`` along its row of ``right``, whole pixels, by normalised
    cross-correlation.

    Parameters
    ----------
    left, right : Float32Array, shape (rows, cols)
        Rectified images.
    points : FloatArray, shape (n, 2)
        x, y in ``left``, pixels.
    lowest, highest : IntArray, shape (n,)
        First and last tested disparity, pixels.
    half : int
        Patches are ``2 half + 1`` pixels wide.

    Returns
    -------
    disparity : FloatArray, shape (n,)
        Best integer disparity; NaN if none could be tested.
    best, second : FloatArray, shape (n,)
        Correlation there, and the highest more than two pixels away from it.
    """
    n = len(points)
    disparity, best, second = np.full(n, np.nan), np.full(n, -1.0), np.full(n, -1.0)
    width = 2 * half + 1
    m = width * width
    T = np.empty((width, width), np.float32)
    for i in range(n):
        x, y = int(np.rint(points[i, 0])), int(np.rint(points[i, 1]))
        first, last = max(lowest[i], x + half + 1 - right.shape[1]), min(highest[i], x - half)
        if x < half or y < half or x >= left.shape[1] - half or y >= left.shape[0] - half or last < first:
            continue
        mean = np.float32(0.0)
        for v in range(width):
            for u in range(width):
                T[v, u] = left[y + v - half, x + u - half]
                mean += T[v, u]
        mean /= np.float32(m)
        energy = np.float32(0.0)
        for v in range(width):
            for u in range(width):
                T[v, u] -= mean
                energy += T[v, u] * T[v, u]
        if energy < _FLAT:
            continue
        scores = np.full(last - first + 1, -1.0)
        for d in range(first, last + 1):
            total, squares, cross = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            for v in range(width):
                for u in range(width):
                    w = right[y + v - half, x - d + u - half]
                    total += w
                    squares += w * w
                    cross += w * T[v, u]
            patch_energy = squares - total * total / np.float32(m)
            if patch_energy > _FLAT:
                scores[d - first] = cross / np.sqrt(patch_energy * energy)
        top = np.argmax(scores)
        disparity[i], best[i] = first + top, scores[top]
        for j in range(len(scores)):
            if abs(j - top) > 2 and scores[j] > second[i]:
                second[i] = scores[j]
    return disparity, best, second
