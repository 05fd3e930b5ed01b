# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""True attitudes of a camera from its images of stars: a JSON file as of the plate solvers tetra3 and cedar.

The file is a map from names of images to right ascension and declination of the optical axis and the roll
angle about it, ``RA``, ``Dec`` and ``Roll``, in degrees. With the unit vectors ``e`` to the east and ``n`` to
the north at the axis ``z``, the x axis of the camera (to the right of the image) is
``-(e cos(Roll) + n sin(Roll))``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs.formats.images.sequences import ImageSequence
from cdff_dev.logs.image_streams import Stamps, pose_stream
from cdff_dev.logs.indexed import IndexedStream

_ANGLES = ("RA", "Dec", "Roll")


def attitude_stream(
    robot: str, path: Path, sequence: ImageSequence, stamps_ns: Stamps
) -> tuple[str, IndexedStream, list[str]] | None:
    """Return the attitudes of the camera in the International Celestial Reference Frame.

    The stream ``/robot/truth.attitude`` has poses of the camera in ``robot/icrf`` with the position 0, which
    is not known.

    Returns
    -------
    tuple or None
        Name of the stream, the stream, and the other fields of the file; None if the file has no attitudes of
        the images of ``sequence``.
    """
    try:
        document = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return None
    if not isinstance(document, dict):
        return None
    solved = [(i, document[f.name]) for i, f in enumerate(sequence.files) if _is_solved(document.get(f.name))]
    if not solved:
        return None
    angles_deg = np.array([[float(entry[name]) for name in _ANGLES] for _, entry in solved])
    if not np.isfinite(angles_deg).all():
        return None
    T = se3.transform(camera_rotations(angles_deg), np.zeros((len(solved), 3)))
    stream = f"/{robot}/truth.attitude"
    chosen = stamps_ns[[i for i, _ in solved]]
    camera = f"{robot}/{sequence.sensor}"
    others = sorted({name for _, entry in solved for name in entry} - set(_ANGLES))
    return stream, pose_stream(stream, T, chosen, parent=f"{robot}/icrf", child=camera), others


def camera_rotations(angles_deg: FloatArray) -> FloatArray:
    """Return the rotations ``(n, 3, 3)`` from cameras to the celestial frame.

    Parameters
    ----------
    angles_deg : array, shape (n, 3)
        Right ascension, declination and roll, degrees.
    """
    ra, dec, roll = np.radians(angles_deg).T
    zero = np.zeros_like(ra)
    z = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=1)
    east = np.stack([-np.sin(ra), np.cos(ra), zero], axis=1)
    north = np.cross(z, east)
    x = -(east * np.cos(roll)[:, None] + north * np.sin(roll)[:, None])
    return np.stack([x, np.cross(z, x), z], axis=2)


def _is_solved(entry: Any) -> bool:
    """Return True if an entry has the three angles."""
    return isinstance(entry, dict) and all(
        isinstance(entry.get(name), int | float) and not isinstance(entry[name], bool) for name in _ANGLES
    )
