# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command lines of ``cdff calibrate hand-eye``, ``camera-lidar`` and ``camera-imu``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_dev.calibrate.frame_output import add_output_options, send_frames, write_frames

if TYPE_CHECKING:
    from cdff_common.geometry import UncertainTransform
    from cdff_core.calibration.relative_pose import RelativePose


def add_sensor_verbs(verbs: Any) -> None:
    """Add the verbs ``hand-eye``, ``camera-lidar`` and ``camera-imu``."""
    parser = _sensor_parser(
        verbs,
        "hand-eye",
        "pose of a camera on a moving hand, from images of a fixed board and poses of the hand",
        "PATH is a log with images and poses, or a folder of images with poses.tum (T_base_hand, one line "
        "for each image). Images that contradict the others are dropped.",
    )
    parser.add_argument(
        "--poses", metavar="FILE", type=Path, help="poses T_base_hand (TUM), if not in the log"
    )
    parser.add_argument(
        "--hand", metavar="STREAM", help="stream of the poses of the hand, if there are several"
    )
    parser.add_argument(
        "--hand-frame", metavar="FRAME", help="frame of the hand (default: that of the poses)"
    )
    parser.set_defaults(run=run_hand_eye)
    parser = _sensor_parser(
        verbs,
        "camera-lidar",
        "pose of a lidar in the frame of a camera, from a board that both see",
        "PATH is a log with images and clouds, or a folder with the folders images and clouds.",
    )
    parser.add_argument("--lidar", metavar="STREAM", help="stream of clouds, if there are several")
    parser.add_argument(
        "--lidar-frame", metavar="FRAME", help="frame of the lidar (default: that of the clouds)"
    )
    parser.add_argument(
        "--panel",
        metavar="WIDTHxHEIGHT",
        help="size of the panel in metres, centred at the pattern (default: the pattern)",
    )
    parser.add_argument(
        "--tolerance-s",
        type=float,
        default=0.02,
        help="largest difference of the stamps of image and scan (default: 0.02)",
    )
    parser.set_defaults(run=run_camera_lidar)
    parser = _sensor_parser(
        verbs,
        "camera-imu",
        "pose, clock offset and biases of an IMU at a camera, from a motion in front of a fixed board",
        "PATH is a log with images and readings, or a folder with imu.csv and the folder images, where the "
        "names of files are times. Images that contradict the others are dropped.",
    )
    parser.add_argument(
        "--readings", metavar="FILE", type=Path, help="table of the readings of the IMU, if not in the log"
    )
    parser.add_argument("--imu", metavar="STREAM", help="readings of the IMU, if there are several streams")
    parser.add_argument(
        "--imu-frame", metavar="FRAME", help="frame of the IMU (default: that of the readings)"
    )
    parser.add_argument(
        "--gravity",
        metavar="G",
        type=float,
        default=9.80665,
        help="acceleration of gravity at this place, m/s2 (default: 9.80665)",
    )
    parser.add_argument(
        "--max-offset-s",
        metavar="S",
        type=float,
        default=1.0,
        help="largest offset of the clocks that is tried (default: 1)",
    )
    parser.set_defaults(run=run_camera_imu)


def _sensor_parser(verbs: Any, verb: str, summary: str, description: str) -> argparse.ArgumentParser:
    """Return the parser of a verb with the common options."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        verb,
        help=summary,
        description=f"{description} No initial guess needed. Exit code 3 if a direction is not determined.",
    )
    parser.add_argument("path", metavar="PATH", type=Path, help="folder or log")
    parser.add_argument("--board", metavar="BOARD", required=True, help="as for cdff calibrate camera")
    parser.add_argument("--camera", metavar="FILE", type=Path, help="calibration, if not that of the images")
    parser.add_argument("--stream", metavar="STREAM", help="images, if there are several streams")
    parser.add_argument(
        "--camera-frame", metavar="FRAME", help="frame of the camera (default: that of the images)"
    )
    parser.add_argument("--profile", metavar="FILE", type=Path, help="profile of --write")
    parser.add_argument("--robot", metavar="ID", help="robot of the profile, if it has several")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder for calibration.json")
    parser.add_argument("--json", action="store_true", help="JSON output")
    add_output_options(parser)
    return parser


def run_hand_eye(args: argparse.Namespace) -> int:
    """Print the pose of the camera in the hand; write it to the profile and the DPM if asked."""
    import numpy as np

    from cdff_core.calibration.robot_world import robot_world_calibration
    from cdff_dev.calibrate.board_files import read_board
    from cdff_dev.calibrate.sensor_data import board_images, hand_poses, poses_at

    _check_options(args)
    images = board_images(args.path, read_board(args.board), args.camera, args.stream)
    hand_frame, stamps, poses = hand_poses(args.path, args.poses, args.hand)
    hands, is_known, paired_by = poses_at(images.stamps_ns, stamps, poses)
    boards = [pose for pose in images.poses if is_known[pose.number]]
    rows = np.array([pose.number for pose in boards], dtype=np.int64)
    result, T_base_board = robot_world_calibration(hands[rows], boards)
    parent, child = args.hand_frame or hand_frame or "hand", args.camera_frame or images.frame or "camera"
    extra: dict[str, Any] = {"T_base_board": T_base_board.tolist(), "images": len(images.stamps_ns)}
    extra["paired_by"] = paired_by
    return _finish(args, result, parent, child, (parent, child, result.transform), extra, images.stamps_ns)


def run_camera_lidar(args: argparse.Namespace) -> int:
    """Print the pose of the lidar in the camera; write its mount to the profile and the DPM if asked."""
    import numpy as np

    from cdff_common.progress import Progress
    from cdff_core.calibration.camera_lidar import camera_lidar_calibration
    from cdff_core.calibration.panels import find_panels
    from cdff_dev.calibrate.board_files import read_board
    from cdff_dev.calibrate.sensor_data import board_images, scans_at

    _check_options(args)
    board = read_board(args.board)
    size_m = board.extent_m if args.panel is None else _size(args.panel)
    images = board_images(args.path, board, args.camera, args.stream)
    lidar_frame, scans, paired_by = scans_at(args.path, images.stamps_ns, args.lidar, args.tolerance_s)
    boards = [pose for pose in images.poses if scans[pose.number] is not None]
    # The lidar is at most as far from the board as the camera and the distance between both sensors.
    reach_m = max((float(np.linalg.norm(p.T_camera_board[:3, 3])) for p in boards), default=0.0) + 2.0
    panels = []
    progress = Progress(len(boards), "scans")
    for pose in boards:
        points = scans[pose.number]
        assert points is not None
        panels.append(find_panels(points, size_m, reach_m))
        progress.advance()
    progress.close()
    centre_m = np.mean([board.corners_m.min(axis=0), board.corners_m.max(axis=0)], axis=0)
    result = camera_lidar_calibration(boards, panels, centre_m=centre_m, diagonal_m=float(np.hypot(*size_m)))
    parent, child = args.camera_frame or images.frame or "camera", args.lidar_frame or lidar_frame or "lidar"
    output = _mount(args, parent, child, result.transform)
    extra: dict[str, Any] = {"images": len(images.stamps_ns), "paired_by": paired_by}
    return _finish(args, result, parent, child, output, extra, images.stamps_ns)


def run_camera_imu(args: argparse.Namespace) -> int:
    """Print pose, clock offset and biases of the IMU; write its mount to the profile and the DPM if asked."""
    from cdff_common.errors import InputError
    from cdff_core.calibration.camera_imu import PARAMETERS, camera_imu_calibration
    from cdff_dev.calibrate.board_files import read_board
    from cdff_dev.calibrate.sensor_data import board_images, imu_readings

    _check_options(args)
    for option, value, largest in (
        ("--gravity", args.gravity, 30.0),
        ("--max-offset-s", args.max_offset_s, 60.0),
    ):
        if not 0.0 < value <= largest:
            raise InputError(f"{option} {value:g}: expected a value above 0 and up to {largest:g}")
    readings = imu_readings(args.path, args.readings, args.imu)
    images = board_images(args.path, read_board(args.board), args.camera, args.stream)
    result = camera_imu_calibration(
        images.stamps_ns,
        images.poses,
        readings.stamps_ns,
        readings.force_m_s2,
        readings.rate_rad_s,
        gravity_m_s2=args.gravity,
        largest_offset_s=args.max_offset_s,
    )
    parent = args.camera_frame or images.frame or "camera"
    child = args.imu_frame or readings.frame or "imu"
    extra: dict[str, Any] = {"images": len(images.stamps_ns), "paired_by": "time"}
    extra |= {"parameters": list(PARAMETERS), "parameter_covariance": result.covariance.tolist()}
    extra |= {"gravity_m_s2": result.values[12:15].tolist()}
    output = _mount(args, parent, child, result.pose.transform)
    return _finish(args, result.pose, parent, child, output, extra, images.stamps_ns)


def _check_options(args: argparse.Namespace) -> None:
    from cdff_common.errors import InputError

    if args.write and args.profile is None:
        raise InputError("--write needs --profile FILE, whose frames are replaced")


def _size(text: str) -> tuple[float, float]:
    """Return width and height of ``0.8x0.6``; raises InputError."""
    from cdff_common.errors import InputError

    try:
        width, height = (float(v) for v in text.lower().split("x"))
    except ValueError as error:
        raise InputError(f"--panel {text!r}: expected WIDTHxHEIGHT in metres, for example 0.8x0.6") from error
    if not (0.1 <= width <= 10.0 and 0.1 <= height <= 10.0):
        raise InputError(f"--panel {text!r}: expected sides between 0.1 and 10 m")
    return width, height


def _mount(
    args: argparse.Namespace, camera: str, sensor: str, T: UncertainTransform
) -> tuple[str, str, UncertainTransform]:
    """Return parent, child and transform of the edge to write: below the base with a profile."""
    if args.profile is None:
        return camera, sensor, T
    from cdff_common.interfaces.profile import load_profile

    profile = load_profile(args.profile)
    robot = profile.robot(args.robot) if args.robot else profile.robots[0]
    base = f"{robot.id}/base"
    return base, sensor, robot.frame_graph().lookup(base, camera, 0) @ T


def _finish(
    args: argparse.Namespace,
    result: RelativePose,
    parent: str,
    child: str,
    output: tuple[str, str, UncertainTransform],
    extra: dict[str, Any],
    stamps_ns: Any,
) -> int:
    """Print the result and write it; return the exit code."""
    from cdff_common.output import write_file
    from cdff_dev.calibrate.sensor_report import sensor_document, sensor_lines

    document = sensor_document(result, parent, child) | extra
    document["valid_from_ns"] = str(int(stamps_ns.max())) if len(stamps_ns) else None
    if args.json:
        print(json.dumps(document, sort_keys=True))
    else:
        print("\n".join(sensor_lines(result, parent, child)))
        print(f"paired by {extra['paired_by']}")
    if args.out is not None:
        args.out.mkdir(parents=True, exist_ok=True)
        text = json.dumps(document, indent=1, sort_keys=True) + "\n"
        write_file(args.out / "calibration.json", text.encode())
    if result.undetermined:
        return 3
    edge_parent, edge_child, T = output
    if args.write:
        robot = args.robot or edge_parent.split("/")[0]
        write_frames(args.profile, robot, edge_parent, {edge_child: T})
        if not args.json:
            print(f"wrote {edge_child} to {args.profile}; the DPM uses it from the next cdff up on")
    if args.dpm:
        lines = send_frames(args, edge_parent, {edge_child: T}, int(stamps_ns.max()))
        if not args.json:
            print("\n".join(lines))
    return 0
