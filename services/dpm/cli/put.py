# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff dpm put``: insertion of a file as a product; its suffix selects the product type."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.bus import Bus, keys
from cdff_common.clock import parse_stamp
from cdff_common.codecs import CODECS, decode, encode, encoding_string
from cdff_common.codecs.wire_types import wire_type
from cdff_common.contract.products import product_of_suffix, product_type
from cdff_common.errors import InputError
from cdff_common.formats.file_source import load
from cdff_common.formats.meshes.arrays import UNITS
from cdff_common.formats.meshes.read import MESH_FORMATS
from cdff_common.interfaces.product import Header, product_id

_TIMEOUT_S = 60.0
#: File formats that are read, by ASN.1 type.
_READABLE = {
    "Pointcloud": ("ply", "pcd", "las", "laz", "bin"),
    "ElevationMap": ("tif",),
    "NavigationMap": ("tif",),
    "TransformWithCovariance": ("json", "tum"),
    "PoseTrajectory": ("tum",),
    "PoseGraph": ("g2o",),
    "Frame": ("png", "pgm", "ppm"),
    "Mesh": MESH_FORMATS,
}


def put(bus: Bus, args: argparse.Namespace) -> dict[str, Any]:
    """Insert a file; returns ``{id, result}``, ``result`` inserted or already.

    Raises
    ------
    InputError
        If the suffix is unknown, or the content does not fit it.
    """
    now_ns = bus.mission_clock.now_ns() // 1000 * 1000
    suffix = args.file.suffix.lower().lstrip(".")
    product = args.type or product_of_suffix(suffix)
    if product is None:
        raise InputError(f"{args.file}: no product has files {suffix!r}: expected --type TYPE")
    stamp_ns = None if args.t is None else parse_stamp(args.t, "t")
    value = read_value(
        args.file,
        suffix,
        product,
        frame=args.frame,
        robot=args.robot,
        stamp_ns=stamp_ns or now_ns,
        unit=args.unit,
    )
    if stamp_ns is None:
        stamp_ns = value.stamp_ns or now_ns
    payload = encode(value, "uper")
    port = args.port or product
    frame = (
        getattr(value, "parent_frame", None)
        or getattr(value, "frame", None)
        or args.frame
        or f"{args.robot}/base"
    )
    t0_ns = min(_start_ns(value, stamp_ns), stamp_ns)
    header = Header(
        product_id(args.robot, args.dfpc, port, stamp_ns, 0, ""),
        0,
        t0_ns,
        stamp_ns,
        frame,
        f"{args.dfpc}/file",
        child=getattr(value, "child_frame", None),
        box_m=value.extent_m(),
        resolution_m=value.geometry.resolution_m if hasattr(value, "geometry") else None,
    )
    reply = bus.call(
        keys.dpm_rpc(keys.GROUND, "put"),
        {"robot": args.robot, "dfpc": args.dfpc, "port": port, "product": product},
        payload=payload,
        encoding=encoding_string(wire_type(value), "uper"),
        attachment=header.to_attachment(),
        timeout_s=_TIMEOUT_S,
    )
    body: dict[str, Any] = reply.body()
    return body


def read_value(
    path: Path, suffix: str, product: str, *, frame: str | None, robot: str, stamp_ns: int, unit: str = "m"
) -> Any:
    """Return the value of a file, of the type of ``product``.

    Parameters
    ----------
    frame : str or None
        Frame of a file that states none; default ``site``, for images and children of poses ``{robot}/base``,
        for a mesh ``{robot}/body``, where the robot is the object.
    stamp_ns : int
        Time of a file that states none.
    unit : str
        Unit of the vertices of a mesh.
    """
    from cdff_common import types

    type_name = product_type(product, "--type").type_name
    if type_name is None:
        raise InputError(f"{path}: a {product} has no type of its own and cannot be put from a file")
    if suffix in CODECS:
        return decode(type_name, load(path).data, suffix)
    if suffix not in _READABLE.get(type_name, ()):
        expected = ", ".join((*CODECS, *_READABLE.get(type_name, ())))
        raise InputError(f"{path}: a {product} is read from {expected}, not from {suffix!r}")
    site, base = frame or "site", f"{robot}/base"
    match type_name:
        case "Pointcloud":
            cloud = _cloud(path, suffix)
            return types.Pointcloud.from_points(
                cloud.points_m,
                frame=site,
                stamp_ns=stamp_ns,
                intensity=_integer_intensity(cloud.intensity),
                colors=cloud.colors,
            )
        case "ElevationMap" | "NavigationMap":
            from cdff_common.formats.geotiff import read_map

            return read_map(path, type_name, frame=site)
        case "TransformWithCovariance":
            from cdff_common.formats.pose import read_pose

            pose = read_pose(path)
            return types.TransformWithCovariance.from_transform(
                pose.T,
                parent=pose.parent or site,
                child=pose.child or base,
                stamp_ns=pose.stamp_ns or stamp_ns,
            )
        case "PoseTrajectory":
            from cdff_common.formats.tum import read_tum

            stamps_ns, matrices = read_tum(path)
            return types.PoseTrajectory.from_arrays(stamps_ns, matrices, None, parent=site, child=base)
        case "Mesh":
            return _mesh(path, frame or f"{robot}/body", unit, stamp_ns)
        case "PoseGraph":
            from cdff_common.formats.pose_graph import read_pose_graph

            return read_pose_graph(path, frame=site)
        case _:  # Frame
            from cdff_common.formats.image import read_image

            image: Any = read_image(path)
            channels: dict[int, str] = {3: "RGB", 4: "RGBA"}
            mode = channels.get(image.shape[-1], "GRAY") if image.ndim > 2 else "GRAY"
            return types.Frame.from_image(image, stamp_ns=stamp_ns, mode=mode, sensor=frame or base)


def _start_ns(value: Any, stamp_ns: int) -> int:
    stamps_ns: Any = getattr(value, "stamps_ns", ())
    return int(stamps_ns[0]) if len(stamps_ns) else int(getattr(value, "t0_ns", 0)) or stamp_ns


def _integer_intensity(intensity: Any) -> Any:
    """Return intensities as whole numbers, as in messages; reflectances of 0 to 1 become thousandths."""
    if intensity is None or not len(intensity):
        return None
    known = np.nan_to_num(intensity)
    return np.rint(np.clip(known * (1000.0 if known.max() <= 1.0 else 1.0), -(2**31), 2**31 - 1)).astype(
        np.int32
    )


def _cloud(path: Path, suffix: str) -> Any:
    from cdff_common.formats.kitti_bin import read_kitti_bin
    from cdff_common.formats.las import read_las
    from cdff_common.formats.pcd import read_pcd
    from cdff_common.formats.ply import read_ply

    return {"ply": read_ply, "pcd": read_pcd, "las": read_las, "laz": read_las, "bin": read_kitti_bin}[
        suffix
    ](path)


def _mesh(path: Path, frame: str, unit: str, stamp_ns: int) -> Any:
    """Return a mesh in metres in the frame of its body; the content selects the format."""
    from cdff_common.formats.meshes.read import read_mesh
    from cdff_common.types import Mesh

    mesh = read_mesh(path)
    vertices_m = UNITS[unit] * np.asarray(mesh.vertices, np.float64)
    return Mesh.from_arrays(vertices_m, mesh.triangles, frame=frame, stamp_ns=stamp_ns)
