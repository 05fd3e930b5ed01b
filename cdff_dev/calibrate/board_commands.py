# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command lines of ``cdff calibrate camera`` and ``cdff calibrate stereo``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from cdff_common.camera.lenses import LENSES

#: Numbers of distortion coefficients of a pinhole.
_COUNTS = (4, 5, 8, 12)


def add_board_verbs(verbs: Any) -> None:
    """Add the verbs ``camera`` and ``stereo``."""
    for verb, cameras, summary in (
        ("camera", 1, "intrinsic parameters of a camera from images of a board"),
        ("stereo", 2, "two cameras and their relative pose from images of a board"),
    ):
        parser = verbs.add_parser(
            verb,
            help=summary,
            description="Detect a board in all images and adjust all parameters together. An initial "
            "guess is not needed. Standard deviations and an assessment are printed. Exit code "
            "3 if the images do not determine the parameters.",
        )
        parser.add_argument("path", metavar="PATH", help="folder of images, or log")
        parser.add_argument(
            "--board",
            metavar="BOARD",
            required=True,
            help="charuco:9x7:0.03:0.022[:DICTIONARY], chessboard:9x6:0.03, aprilgrid:6x6:0.088:0.3, "
            "tags:4x3:0.09:0.26, or a target file of Kalibr (metres)",
        )
        parser.add_argument("--lens", choices=list(LENSES), default="pinhole", help="lens (default: pinhole)")
        parser.add_argument(
            "--coefficients", type=int, choices=_COUNTS, default=5, help="of the pinhole lens (default: 5)"
        )
        parser.add_argument(
            "--stream",
            metavar="STREAM",
            action="append",
            default=[],
            help="images, if there are several streams",
        )
        parser.add_argument("--out", metavar="DIR", type=Path, help="folder of the results")
        parser.add_argument("--json", action="store_true", help="JSON output")
        parser.set_defaults(run=run, cameras=cameras)


def run(args: argparse.Namespace) -> int:
    """Print the calibration and its assessment, and write it to the folder of ``--out``."""
    from cdff_core.calibration.assessment import judged
    from cdff_core.calibration.rig import calibrate_rig
    from cdff_dev.calibrate.board_files import read_board
    from cdff_dev.calibrate.board_report import document, lines, write_results
    from cdff_dev.calibrate.board_views import board_views
    from cdff_dev.logs.opened import opened

    board = read_board(args.board)
    with opened(args.path) as log:
        found = board_views(log, board, args.cameras, args.stream)
    result = calibrate_rig(found.views, found.sizes, args.lens, args.coefficients)
    assessment = judged(result)
    if args.out is not None:
        write_results(args.out, result, assessment, found.images)
    if args.json:
        print(json.dumps(document(result, assessment, found.images), sort_keys=True))
    else:
        print("\n".join(lines(result, assessment, found.images)))
        if args.out is not None:
            print(f"wrote calibration.yaml, calibration.json and pictures to {args.out}")
    return 3 if assessment.unobservable else 0
