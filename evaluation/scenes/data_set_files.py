# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Small folders in the layouts of data sets of images with true poses."""

from __future__ import annotations

import json
from typing import Any

import cv2
import numpy as np

#: Files of a recording by their path in its folder.
Files = dict[str, bytes]
_IMAGE = np.arange(48, dtype=np.uint8).reshape(6, 8)
_KINECT_IMAGE = np.zeros((480, 640), np.uint8)
_K = [7.0, 0.0, 4.5, 0.0, 7.0, 2.8, 0.0, 0.0, 1.0]
_P0, _P1 = "7 0 4.5 0 0 7 2.8 0 0 0 1 0", "7 0 4.5 -3.5 0 7 2.8 0 0 0 1 0"
_POINTS_M = np.array([[5.0, 1.0, -1.7], [3.0, 4.0, 0.5], [2.0, -3.0, 0.1]])
_TIMES_NS = (1_600_000_000_000_000_000, 1_600_000_000_100_000_000)


def encoded_png(image: Any = _IMAGE) -> bytes:
    """Return an image, by default grey of 8 x 6 pixels, as PNG."""
    return bytes(cv2.imencode(".png", image)[1].tobytes())


def _json(document: Any) -> bytes:
    return json.dumps(document).encode()


def _object_pose(number: int) -> dict[str, Any]:
    return {"obj_id": number, "cam_R_m2c": np.eye(3).ravel().tolist(), "cam_t_m2c": [10.0, 20.0, 900.0]}


def bop_scene() -> Files:
    """A scene of two images with depth, masks and two objects."""
    files = {f"rgb/{n:06d}.png": encoded_png() for n in (0, 3)}
    files |= {f"depth/{n:06d}.png": encoded_png(np.full((6, 8), 50, np.uint16)) for n in (0, 3)}
    camera = {"cam_K": _K, "depth_scale": 0.1}
    truth = {"0": [_object_pose(5), _object_pose(5), _object_pose(7)], "3": [_object_pose(7)]}
    return files | {
        "mask/000000_000000.png": encoded_png(),
        "scene_camera.json": _json({"0": camera, "3": camera}),
        "scene_gt.json": _json(truth),
    }


def bop_frame() -> Files:
    """A single image with depth and the pose of one object."""
    return {
        "rgb.png": encoded_png(),
        "depth.png": encoded_png(np.full((6, 8), 50, np.uint16)),
        "truth.json": _json({"camera": {"cam_K": _K, "depth_scale": 1.0}, "pose": _object_pose(1)}),
    }


def seven_scenes() -> Files:
    """Two frames with a pose file each."""
    pose = b"1 0 0 0.5\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    files = {f"frame-{n:06d}.pose.txt": pose for n in range(2)}
    files |= {f"frame-{n:06d}.color.png": encoded_png(_KINECT_IMAGE) for n in range(2)}
    depth = encoded_png(np.full((480, 640), 900, np.uint16))
    return files | {"frame-000000.depth.png": depth}


def seven_scenes_extract() -> Files:
    """An extract with the poses in one table."""
    pose = "1,0,0,0.5,0,1,0,0,0,0,1,0"
    files = {f"frames/{n:06d}.color.png": encoded_png(_KINECT_IMAGE) for n in range(2)}
    return files | {"truth.csv": f"frame,{','.join('T' * 12)}\n0,{pose}\n1,{pose}\n".encode()}


def speed() -> Files:
    """Two labelled images of a spacecraft."""
    camera = {
        "Nu": 8,
        "Nv": 6,
        "cameraMatrix": np.reshape(_K, (3, 3)).tolist(),
        "distCoeffs": [0.0] * 5,
    }
    pose = {"q_vbs2tango_true": [0.0, 0.0, 0.0, 1.0], "r_Vo2To_vbs_true": [0.1, 0.2, 5.0]}
    labels = [{"filename": f"img{n:06d}.png", **pose} for n in (1, 2)]
    files = {f"images/img{n:06d}.png": encoded_png() for n in (1, 2)}
    return files | {"camera.json": _json(camera), "test.json": _json(labels)}


def euroc_pairs() -> Files:
    """Stereo pairs with Kalibr's calibration and true poses."""
    cameras = ""
    for number, x_m in ((0, 0.0), (1, -0.11)):
        cameras += f"cam{number}:\n  T_cam_imu:\n  - [1.0, 0.0, 0.0, {x_m}]\n"
        cameras += "  - [0.0, 1.0, 0.0, 0.0]\n  - [0.0, 0.0, 1.0, 0.0]\n  - [0.0, 0.0, 0.0, 1.0]\n"
        cameras += "  camera_model: pinhole\n  intrinsics: [7.0, 7.0, 4.5, 2.8]\n  resolution: [8, 6]\n"
        cameras += "  distortion_model: radtan\n  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]\n"
    files = {f"map/{time}_{number}.png": encoded_png() for time in _TIMES_NS for number in (0, 1)}
    poses = "".join(f"{time},1,2,3,0,0,0,1\n" for time in _TIMES_NS)
    truth = f"timestamp_ns,tx_m,ty_m,tz_m,qx,qy,qz,qw\n{poses}"
    return files | {"calibration.yaml": cameras.encode(), "truth_map.csv": truth.encode()}


def kitti() -> Files:
    """A sequence of KITTI odometry with two pairs, a scan and true poses."""
    files = {f"image_{c}/{k:06d}.png": encoded_png() for c in (0, 1) for k in range(2)}
    scan = np.column_stack([_POINTS_M, [0.1, 0.5, 1.0]]).astype("<f4").tobytes()
    return files | {
        "calib.txt": f"P0: {_P0}\nP1: {_P1}\n".encode(),
        "times.txt": b"0.0\n0.1\n",
        "poses.txt": b"1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 1\n",
        "velodyne/000001.bin": scan,
    }


def kitti_raw() -> Files:
    """A raw drive of KITTI with two pairs, scans and fixes."""
    times = b"2011-09-26 13:02:25.964389445\n2011-09-26 13:02:26.064389445\n"
    scan = np.column_stack([_POINTS_M, [0.1, 0.5, 1.0]]).astype("<f4").tobytes()
    K = b"7 0 4.5 0 7 2.8 0 0 1"
    files = {f"image_0{c}/data/{k:010d}.png": encoded_png() for c in (0, 1) for k in range(2)}
    files |= {f"oxts/data/{k:010d}.txt": b"49.0 8.4 112.0" + b" 0.01" * 27 for k in range(2)}
    files |= {f"velodyne_points/data/{k:010d}.bin": scan for k in range(2)}
    files |= {f"{name}/timestamps.txt": times for name in ("image_00", "image_01", "oxts", "velodyne_points")}
    lines = [b"calib_time: 09-Jan-2012 13:57:47"]
    for k, P in enumerate((_P0, _P1)):
        name = b"0%d" % k
        lines += [b"S_%s: 8 6" % name, b"K_%s: %s" % (name, K), b"R_%s: 1 0 0 0 1 0 0 0 1" % name]
        lines += [b"T_%s: 0 0 0" % name, b"S_rect_%s: 8 6" % name, b"P_rect_%s: %s" % (name, P.encode())]
    place = b"R: 1 0 0 0 1 0 0 0 1\nT: -0.8 0.3 -0.8\n"
    return files | {
        "calib_cam_to_cam.txt": b"\n".join(lines),
        "calib_imu_to_velo.txt": place,
        "calib_velo_to_cam.txt": place,
    }


def euroc() -> Files:
    """A recording of EuRoC with one pair, an IMU sample and a true pose."""
    camera = "camera_model: pinhole\nintrinsics: [7, 7, 4.5, 2.8]\nresolution: [8, 6]\n"
    camera += "distortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\n"
    files: Files = {}
    for number, x in ((0, 0.0), (1, 0.11)):
        pose = f"T_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, {x}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
        files[f"mav0/cam{number}/sensor.yaml"] = (camera + pose).encode()
        files[f"mav0/cam{number}/data.csv"] = b"#timestamp,filename\n%d,%d.png\n" % (
            _TIMES_NS[0],
            _TIMES_NS[0],
        )
        files[f"mav0/cam{number}/data/{_TIMES_NS[0]}.png"] = encoded_png()
    files["mav0/imu0/data.csv"] = b"#timestamp,w,a\n%d,0.1,0.2,0.3,1,2,9.8\n" % _TIMES_NS[0]
    files["mav0/state_groundtruth_estimate0/data.csv"] = b"#t,p,q\n%d,1,2,3,1,0,0,0\n" % _TIMES_NS[0]
    return files


def tum() -> Files:
    """A recording of TUM RGB-D with one frame."""
    depth = np.full((480, 640), 5000, np.uint16)
    return {
        "rgb.txt": b"# timestamp filename\n1600000000.1 rgb/1.png\n",
        "depth.txt": b"1600000000.1 depth/1.png\n",
        "groundtruth.txt": b"1600000000.1 1 2 3 0 0 0 1\n",
        "accelerometer.txt": b"1600000000.1 1 2 3\n",
        "rgb/1.png": encoded_png(np.zeros((480, 640), np.uint8)),
        "depth/1.png": encoded_png(depth),
    }


def images() -> Files:
    """Two stereo pairs with calibration, times and true poses."""
    matrix = "!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [7, 0, 4.5, 0, 7, 2.8, 0, 0, 1]\n"
    stereo = f"%YAML:1.0\n---\nM1: {matrix}M2: {matrix}D1: []\nD2: []\n"
    stereo += "R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [-0.2, 0, 0]\n"
    files = {f"{side}/{k}.png": encoded_png() for side in ("left", "right") for k in (1, 2)}
    truth = b"image,qw,qx,qy,qz,tx_m,ty_m,tz_m\n1.png,1,0,0,0,0,0,0\n"
    return files | {"camera.yaml": stereo.encode(), "left/times.txt": b"0.1\n0.2\n", "truth.csv": truth}
