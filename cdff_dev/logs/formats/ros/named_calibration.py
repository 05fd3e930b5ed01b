# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calibration file that the user names, in the place of the calibrations of a recording."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

import numpy as np

from cdff_common.camera import CameraModel, StereoCalibration, read_camera, read_stereo
from cdff_common.errors import InputError
from cdff_dev.logs.stereo_pairs import counterpart

#: Number of coefficients of the distortion model plumb_bob of ROS.
_PLUMB_BOB = 5


@dataclass(frozen=True, slots=True, eq=False)
class NamedCalibration:
    """Cameras of a file.

    Attributes
    ----------
    camera : CameraModel
        First camera.
    stereo : StereoCalibration or None
        First two cameras; None if the file has one, or no pose of the second in the first.
    """

    camera: CameraModel
    stereo: StereoCalibration | None

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file; raises InputError if it is no calibration."""
        camera = read_camera(path)
        try:
            return cls(camera, read_stereo(path))
        except InputError:  # the file has one camera, or no pose of the second one
            return cls(camera, None)

    def info(self, topic: str, images: Collection[str]) -> Any:
        """Return the fields of ``CameraInfo`` for a topic of images.

        Of topics called left and right (as in ``stereo_pairs``) the right one has the second camera.
        """
        rights = {names[0] for name in images if (names := counterpart(name)) is not None}
        is_right = self.stereo is not None and topic in rights
        camera = self.stereo.right if self.stereo is not None and is_right else self.camera
        model = "plumb_bob" if len(camera.distortion) <= _PLUMB_BOB else "rational_polynomial"
        return SimpleNamespace(
            height=camera.rows,
            width=camera.cols,
            distortion_model={"pinhole": model, "fisheye": "equidistant"}.get(camera.lens, camera.lens),
            d=np.array(camera.distortion),
            k=camera.matrix.ravel(),
            r=np.eye(3).ravel(),
            p=np.hstack([camera.matrix, np.zeros((3, 1))]).ravel(),
        )
