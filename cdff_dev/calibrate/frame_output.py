# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calibrated frames in a profile and in a running DPM, with the interval in which they are valid."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from cdff_common.cli import add_connect_option
from cdff_common.errors import InputError

if TYPE_CHECKING:
    from cdff_common.geometry import UncertainTransform

_CALL_S = 10.0


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--write``, ``--dpm``, ``--valid-from``, ``--valid-until`` and the address of the router."""
    parser.add_argument(
        "--write", action="store_true", help="replace the frames in the file of --profile; comments are kept"
    )
    parser.add_argument("--dpm", action="store_true", help="add the frames with covariance to a running DPM")
    parser.add_argument(
        "--valid-from", metavar="T", help="with --dpm: from this time on (default: the end of the log)"
    )
    parser.add_argument("--valid-until", metavar="T", help="with --dpm: until this time (default: unlimited)")
    add_connect_option(parser)


def write_frames(path: Path, robot: str, parent: str, frames: Mapping[str, UncertainTransform]) -> None:
    """Replace the transforms of frames below ``parent`` in a profile, and check the profile."""
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.output import write_file
    from cdff_dev.calibrate.profile_edit import with_frames

    write_file(path, with_frames(path.read_text(encoding="utf-8"), robot, parent, frames).encode())
    load_profile(path)


def send_frames(
    args: argparse.Namespace, parent: str, frames: Mapping[str, UncertainTransform], end_ns: int
) -> list[str]:
    """Add a revision of each frame with a covariance to the DPM; return one line for each.

    Raises
    ------
    InputError
        If the interval of ``--valid-from`` and ``--valid-until`` is empty.
    """
    from cdff_common.bus import Bus, keys
    from cdff_common.bus.message import pack
    from cdff_common.clock import parse_stamp

    from_ns = end_ns if args.valid_from is None else parse_stamp(args.valid_from, "--valid-from")
    until_ns = None if args.valid_until is None else parse_stamp(args.valid_until, "--valid-until")
    if until_ns is not None and until_ns <= from_ns:
        raise InputError(f"--valid-until {until_ns} ns: expected a time after {from_ns} ns, see --valid-from")
    lines = []
    with Bus.open(args.connect, name="cdff calibrate") as bus:
        for frame, T in frames.items():
            if T.covariance is None:
                continue
            body = {
                "frame": frame,
                "parent": parent,
                "T": T.matrix.tolist(),
                "covariance": T.covariance.tolist(),
                "valid_from_ns": from_ns,
            } | ({} if until_ns is None else {"valid_until_ns": until_ns})
            key = keys.dpm_rpc(keys.GROUND, "frames")
            bus.call(key, payload=pack(body), encoding="application/msgpack", timeout_s=_CALL_S)
            end = "" if until_ns is None else f" until {until_ns} ns"
            lines.append(f"{frame}: revision in the DPM, valid from {from_ns} ns{end}")
    return lines
