# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scenes of PCL's recognition tutorials as depth images, and the mesh of the milk carton in one of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.formats.pcd import read_pcd
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import DistanceImage, Mesh, Time
from evaluation.data_sets.clouds import PCL_MILK, milk_carton

#: The scenes have y up and z backwards, a depth camera has y down and z forwards.
R_CAMERA_SCENE = np.diag([1.0, -1.0, -1.0, 1.0])
T_CAMERA_CARTON = R_CAMERA_SCENE @ PCL_MILK
#: Rows and columns of the scenes, and the camera: focal length and principal point, pixels.
_SHAPE, _FOCAL, _CENTRE = (480, 640), 525.0, (319.5, 239.5)
#: Radii of the balls that connect the points of the carton, metres.
_RADII_M = (0.003, 0.006, 0.012)


def carton_mesh(data: Path) -> Sample:
    """Return the triangles between the points of the carton by ball pivoting, as a model.

    Normals point away from the centre of the box around the points.
    """
    import open3d as o3d

    points_m, _, _ = milk_carton(data)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(30))
    centre_m = 0.5 * (points_m.min(axis=0) + points_m.max(axis=0))
    normals = np.asarray(cloud.normals)
    signs = np.sign(np.einsum("ij,ij->i", normals, points_m - centre_m))
    cloud.normals = o3d.utility.Vector3dVector(normals * signs[:, None])
    mesh = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(
        cloud, o3d.utility.DoubleVector(_RADII_M)
    )
    vertices, triangles = np.asarray(mesh.vertices, np.float32), np.asarray(mesh.triangles, np.int32)
    value = Mesh.from_arrays(vertices, triangles, frame="carton/body", stamp_ns=0)
    return Sample("model", 0, 0, value, id="carton")


def scene_with_carton(data: Path) -> DistanceImage:
    """Return the depth image that shows the carton once, at ``T_CAMERA_CARTON``."""
    folder = data / "pcl_recognition" / "correspondence_grouping"
    return _depth_image(
        read_pcd(folder / "milk_cartoon_all_small_clorox.pcd").points_m @ R_CAMERA_SCENE[:3, :3]
    )


def scene_with_person(data: Path) -> DistanceImage:
    """Return the depth image of a person, without a carton."""
    return _depth_image(read_pcd(data / "pcl_recognition" / "template_alignment" / "person.pcd").points_m)


def _depth_image(points_m: FloatArray) -> DistanceImage:
    """Return the depth image of the points (480 * 640, 3) of all pixels, in the camera frame."""
    depth_m = np.nan_to_num(points_m[:, 2])
    return DistanceImage(
        ref_time=Time.from_ns(0),
        width=_SHAPE[1],
        height=_SHAPE[0],
        scale_x=1.0 / _FOCAL,
        scale_y=1.0 / _FOCAL,
        center_x=-_CENTRE[0] / _FOCAL,
        center_y=-_CENTRE[1] / _FOCAL,
        data=depth_m,
    )
