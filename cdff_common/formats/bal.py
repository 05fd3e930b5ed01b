# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bundle Adjustment in the Large (BAL): problems as text, one lens (f, k1, k2) per camera.

Agarwal et al. (2010), doi:10.1007/978-3-642-15552-9_3. A BAL camera looks along -z with y up, its pixels are
counted from the image centre, rows upwards; a CDFF camera looks along z with y down. Residuals have the same
size, with the opposite sign of rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.formats.file_source import Readable, load
from cdff_common.geometry import se3
from cdff_common.types import BundleProblem
from cdff_common.types.bundle_ext import FOCAL, K1, K2

_R_CDFF_BAL = np.diag([1.0, -1.0, -1.0])


def read_bal(source: Readable, *, frame: str) -> BundleProblem:
    """Read a problem; focal length, k1 and k2 of every camera are adjusted, as defined by the format.

    Raises
    ------
    CodecError
        If counts are wrong or numbers are not finite; the message names the file.
    """
    s = load(source)
    try:
        numbers = np.array(s.data.split(), dtype=np.float64)
    except ValueError as error:
        raise s.error(f"expected numbers only: {error}") from error
    if len(numbers) < 3 or not np.isfinite(numbers).all():
        raise s.error("expected finite numbers, cameras, points and observations first")
    cameras, points, observations = (int(n) for n in numbers[:3])
    expected = 3 + 4 * observations + 9 * cameras + 3 * points
    if min(cameras, points, observations) < 0 or len(numbers) != expected:
        text = f"{cameras} cameras, {points} points, {observations} observations"
        raise s.error(f"{text}: {len(numbers)} numbers, expected {expected}")
    table = numbers[3 : 3 + 4 * observations].reshape(-1, 4)
    values = numbers[3 + 4 * observations :][: 9 * cameras].reshape(-1, 9)
    T_camera_frame = se3.transform(_R_CDFF_BAL @ se3.exp_so3(values[:, :3]), values[:, 3:6] @ _R_CDFF_BAL)
    lenses = np.zeros((cameras, 9))
    lenses[:, 0] = lenses[:, 1] = values[:, 6]
    lenses[:, 4:6] = values[:, 7:9]
    try:
        return BundleProblem.from_arrays(
            se3.inverse(T_camera_frame),
            lenses,
            numbers[len(numbers) - 3 * points :].reshape(-1, 3),
            (table[:, 0], table[:, 1]),
            table[:, 2:] * [1.0, -1.0],
            frame=frame,
            lens_of_camera=np.arange(cameras),
            free=FOCAL | K1 | K2,
        )
    except InputError as error:
        raise s.error(str(error)) from error


def fits_bal(problem: BundleProblem) -> bool:
    """Return whether BAL can represent a problem: one lens (f, k1, k2) per image, centred, no prior."""
    v = problem.lenses.values
    rows = problem.cameras.lenses
    one_lens_per_image = len(np.unique(rows)) == len(rows) == len(v)
    is_centred = bool((v[:, 0] == v[:, 1]).all() and not v[:, [2, 3, 6, 7, 8, 9]].any())
    return one_lens_per_image and is_centred and not len(problem.prior.cameras) and not _is_stereo(problem)


def write_bal(problem: BundleProblem) -> bytes:
    """Return a problem in BAL format; raises InputError if BAL cannot represent it."""
    if not fits_bal(problem):
        raise InputError(
            "BundleProblem as bal: expected one lens (f, k1, k2) a camera, no stereo pairs, no prior"
        )
    T = se3.inverse(problem.cameras.matrices)
    v = problem.lenses.values[problem.cameras.lenses]
    parameters = np.column_stack(
        [se3.log_so3(_R_CDFF_BAL @ T[:, :3, :3]), T[:, :3, 3] @ _R_CDFF_BAL, v[:, 0], v[:, 4:6]]
    )
    o = problem.observations
    lines = [f"{len(T)} {len(problem.points.ids)} {len(o.cameras)}"]
    observations = zip(
        o.cameras.tolist(),
        o.points.tolist(),
        o.pixels[:, 0].tolist(),
        (-o.pixels[:, 1]).tolist(),
        strict=True,
    )
    lines += [f"{camera} {point} {x!r} {y!r}" for camera, point, x, y in observations]
    lines += [
        repr(x) for x in (*parameters.reshape(-1).tolist(), *problem.points.positions.reshape(-1).tolist())
    ]
    return ("\n".join(lines) + "\n").encode()


def _is_stereo(problem: BundleProblem) -> bool:
    right: NDArray[np.float64] = problem.observations.pixels[:, 2]
    return bool(np.isfinite(right).any())
