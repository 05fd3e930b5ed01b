# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Camera models, stereo calibration, and calibration files."""

from cdff_common.camera.image_size import check_image_size
from cdff_common.camera.lens_names import lens_named
from cdff_common.camera.lenses import LENSES, LensName
from cdff_common.camera.model import CameraModel
from cdff_common.camera.read import read_camera, read_cameras, read_depth_unit, read_stereo
from cdff_common.camera.stereo import StereoCalibration

__all__ = [
    "LENSES",
    "CameraModel",
    "LensName",
    "StereoCalibration",
    "check_image_size",
    "lens_named",
    "read_camera",
    "read_cameras",
    "read_depth_unit",
    "read_stereo",
]
