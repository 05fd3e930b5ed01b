# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of an estimation: trajectory, map, graph, outputs, pictures, ``run.json`` and ``report.html``."""

from __future__ import annotations

import json
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.cli import distribution_version
from cdff_common.errors import CdffError
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.geotiff import write_map
from cdff_common.formats.ply import write_ply
from cdff_common.formats.pose_graph import write_pose_graph
from cdff_common.formats.tum import write_tum
from cdff_common.formats.visual_map import write_visual_map
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.json_form import jsonable
from cdff_common.output import make_folder, write_file
from cdff_common.types import Pointcloud, TransformWithCovariance, VisualMap
from cdff_dev.compare.trajectory.compare import Comparison, compare
from cdff_dev.logs import LogWriter
from cdff_dev.logs.source import recorded_header
from cdff_dev.slam.elevation import ELEVATION_DFPC, Elevation
from cdff_dev.slam.estimation import Estimation
from cdff_dev.slam.html_report import run_report
from cdff_dev.slam.odometry_graph import odometry_graph
from cdff_dev.slam.pictures import elevation_picture, map_picture, map_plane, trajectory_picture
from cdff_dev.slam.stereo_map import StereoMap

#: Distributions whose versions are in ``run.json``.
_LIBRARIES = ("numpy", "numba", "scipy", "opencv-python-headless")


def write_files(
    estimation: Estimation,
    folder: Path,
    elevation: Elevation | None = None,
    stereo_map: StereoMap | None = None,
) -> dict[str, Any]:
    """Write all files of an estimation and its maps; return the content of ``run.json``.

    Raises
    ------
    StorageError
        If the folder cannot be written.
    """
    make_folder(folder)
    track = estimation.track
    T = se3.inverse(track.matrices[0]) @ track.matrices
    write_file(folder / "trajectory.tum", write_tum(track.stamps_ns, T))
    rows = (" ".join(f"{v:.9g}" for v in pose[:3].ravel()) for pose in T)
    write_file(folder / "trajectory_kitti.txt", "".join(f"{row}\n" for row in rows).encode())
    if (cloud := estimation.values.get("cloud")) is not None:
        write_file(folder / "map.ply", write_ply(CloudArrays.of(cloud.points_m)))
        write_file(folder / "map.png", map_picture(np.asarray(cloud.points_m), track.positions_m))
    if stereo_map is not None:
        colors = np.repeat(stereo_map.grey[:, None], 3, axis=1)
        write_file(folder / "map.ply", write_ply(CloudArrays.of(stereo_map.points_m, colors=colors)))
        write_file(folder / "map.png", map_picture(stereo_map.points_m, T[:, :3, 3]))
    if isinstance(visual_map := estimation.values.get("map"), VisualMap):
        write_file(folder / "map.npz", write_visual_map(visual_map))
    graph = estimation.values.get("graph")
    if graph is None:
        graph = odometry_graph(track, _origin_frame(estimation))
    write_file(folder / "graph.g2o", write_pose_graph(graph))
    if elevation is not None:
        write_file(folder / "dem.tif", write_map(elevation.map))
        write_file(folder / "dem.png", elevation_picture(elevation.map))
    _write_outputs(estimation, elevation, stereo_map, folder / "outputs.msg")
    comparison, reason = _comparison(estimation)
    plane = None if stereo_map is None else map_plane(stereo_map.points_m, T[:, :3, 3])
    write_file(folder / "trajectory.png", trajectory_picture(track, comparison, plane))
    summary = {
        "cdff": distribution_version(),
        "versions": _versions(),
        **estimation.run,
        "path_length_m": float(track.distances_m[-1]),
        "duration_s": float(track.stamps_ns[-1] - track.stamps_ns[0]) * 1e-9,
        "truth": reason if comparison is None else comparison.results,
    }
    if elevation is not None:
        summary["dem"] = elevation.run
    if stereo_map is not None:
        summary["map"] = stereo_map.run
    if comparison is not None:
        frames = {"estimate": estimation.child, "truth": estimation.truth.frame}
        summary["truth"] = {**comparison.results, "frames": frames}
    document: dict[str, Any] = jsonable(summary)
    write_file(folder / "report.html", run_report(document, estimation, comparison, folder))
    write_file(folder / "run.json", (json.dumps(document, indent=1, sort_keys=True) + "\n").encode())
    return document


def _write_outputs(
    estimation: Estimation, elevation: Elevation | None, stereo_map: StereoMap | None, path: Path
) -> None:
    """Write the poses with their quality, the last products of the other ports, and the maps, as a log."""
    with LogWriter(path) as writer:
        for product in sorted(estimation.products, key=lambda item: item.header.t1_ns):
            name = f"/{product.robot}/{product.dfpc}.{product.port}"
            writer.write(name, product.value, product.header.t1_ns, product.header)
        if elevation is not None:
            _write_elevation(estimation, elevation, writer)
        if stereo_map is not None:
            _write_stereo_map(estimation, stereo_map, writer)


def _write_stereo_map(estimation: Estimation, stereo_map: StereoMap, writer: LogWriter) -> None:
    """Write the points of a stereo map as a cloud in the frame of the trajectory."""
    pose, frame = estimation.products[0], _origin_frame(estimation)
    stream, stamp_ns = f"/{pose.robot}/{pose.dfpc}.cloud", int(estimation.track.stamps_ns[-1])
    points_m = se3.transform_points(estimation.track.matrices[0], stereo_map.points_m)
    cloud = Pointcloud.from_points(points_m, frame=frame, stamp_ns=stamp_ns, intensity=stereo_map.grey)
    writer.write(stream, cloud, stamp_ns, recorded_header(stream, 0, stamp_ns, frame=frame))


def _origin_frame(estimation: Estimation) -> str:
    """Return the frame of the poses."""
    return next((p.header.frame for p in estimation.products if p.header.child), "")


def _write_elevation(estimation: Estimation, elevation: Elevation, writer: LogWriter) -> None:
    """Write the elevation map, and the pose of the frame of the trajectory in that of the map."""
    pose = next(product for product in estimation.products if product.header.child)
    t0_ns, t1_ns = (int(estimation.track.stamps_ns[i]) for i in (0, -1))
    origin = TransformWithCovariance.from_transform(
        UncertainTransform(elevation.T_start_origin),
        parent=elevation.map.frame,
        child=pose.header.frame,
        stamp_ns=t0_ns,
    )
    writer.write(f"/{pose.robot}/{ELEVATION_DFPC}.origin", origin, t0_ns)
    writer.write(f"/{pose.robot}/{ELEVATION_DFPC}.map", elevation.map, t1_ns)


def _versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries that the results depend on."""
    installed = {name: version(name) for name in _LIBRARIES if _is_installed(name)}
    return {"python": platform.python_version(), "machine": platform.machine(), **installed}


def _is_installed(name: str) -> bool:
    """Return whether a package is installed."""
    try:
        version(name)
    except PackageNotFoundError:
        return False
    return True


def _comparison(estimation: Estimation) -> tuple[Comparison | None, str]:
    """Return the comparison with the true poses, or None and the reason."""
    if estimation.truth.track is None:
        return None, estimation.truth.fault
    try:
        return compare(estimation.track, estimation.truth.track), ""
    except CdffError as error:
        return None, str(error)
