# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff replay``: ``--dfpc NAME`` for one DFPC, ``--requests FILE`` for a mission."""

from __future__ import annotations

import argparse
import json
import math
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_common.cli import add_plot_option

if TYPE_CHECKING:
    from cdff_dev.logs import LogSource


#: Options of ``--dfpc`` that a mission does not take.
_OF_ONE_DFPC = ("implementation", "config", "robot", "seed", "start", "duration", "until", "guess", "poses")


def register(nouns: Any) -> None:
    """Add ``cdff replay``."""
    parser = nouns.add_parser(
        "replay", help="replay a log through a DFPC or a mission, without middleware, repeatably"
    )
    parser.add_argument("log", help="a log file, a folder, a _*.msg pattern, or a KITTI folder")
    mode = parser.add_mutually_exclusive_group(required=True)
    mode.add_argument("--dfpc", help="replay one DFPC, with all streams of the log that fit its ports")
    mode.add_argument(
        "--requests",
        metavar="FILE",
        help="replay a mission: a YAML file of requests, for which the DFPCs of the profile are activated",
    )
    parser.add_argument(
        "--store", metavar="DIR", help="with --requests: store the products in the DPM of this directory"
    )
    parser.add_argument("--implementation", help="implementation of the DFPC")
    parser.add_argument("--config", help="YAML file with parameters of the DFPC")
    parser.add_argument("--profile", help="profile with the frames, limits, wiring and parameters")
    parser.add_argument("--robot", help="robot of the log (default: the only one)")
    parser.add_argument(
        "--map",
        action="append",
        default=[],
        metavar="PORT=STREAM|MAP",
        help="wire a stream of the log to a port of the DFPC; may be repeated; "
        "or the file of a map (cdff map build)",
    )
    parser.add_argument(
        "--mask",
        action="append",
        default=[],
        metavar="FILE",
        help="image whose black pixels show the robot, for the left camera; a second --mask is for the right",
    )
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        type=Path,
        help="calibration of the stereo camera of a KITTI folder (OpenCV, Kalibr or KITTI; default: "
        "calib_kitti.txt, calib.txt)",
    )
    parser.add_argument(
        "--model",
        action="append",
        default=[],
        metavar="FILE",
        help="with --dfpc: mesh of a body (OBJ, PLY, STL, GLB, VRML); may be repeated",
    )
    parser.add_argument(
        "--guess", metavar="FILE", help="with --dfpc: pose at the first sample (.json, .txt or .tum)"
    )
    parser.add_argument(
        "--poses",
        metavar="FILE",
        help="with --dfpc: poses for its port poses, with the times of the log (TUM, EuRoC, table of images)",
    )
    parser.add_argument("--speed", default="max", help="mission seconds per second, or max (the default)")
    parser.add_argument(
        "--start",
        metavar="S",
        help="begin S seconds after the first sample, before the end if negative (--start=-10), or at a time",
    )
    parser.add_argument("--duration", type=float, metavar="S", help="replay S seconds of the log")
    parser.add_argument(
        "--until",
        metavar="CONDITION",
        help="end at the first product that fulfils it, such as 'pose.status==FAILED', 'pose.sigma_m>0.5' or "
        "'pose.metrics.inliers<30'",
    )
    parser.add_argument(
        "--tap",
        action="append",
        default=[],
        metavar="PORT",
        help="print each value of a port in words; may be repeated",
    )
    parser.add_argument("--seed", type=int, default=None, help="seed of the random numbers of the DFPC")
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="folder for outputs.msg, summary.json, <port>.tum (relative to the first pose, or absolute for "
        "tracked bodies) and the last maps, graphs and clouds",
    )
    parser.add_argument(
        "--sweep",
        metavar="FILE",
        help="with --dfpc and --out: replay all combinations of the values in a YAML file "
        "{NAME: [VALUE, …]} of parameters, seed, implementation, start or duration; a repetition continues",
    )
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="with --sweep: execute the replays on the workers of a scheduler of Dask, tcp://HOST:8786",
    )
    add_plot_option(parser)
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Replay; return 0.

    Raises
    ------
    RefusedError
        If no sample was accepted, or every output of the DFPC is FAILED (exit code 3).
    """
    from cdff_common.errors import InputError
    from cdff_dev.logs.opened import opened

    if args.plot is not None:
        from cdff_common.plots import check_plot_file

        check_plot_file(args.plot)
    if args.dfpc and args.store:
        raise InputError("--store needs --requests; the outputs of one DFPC are written to --out only")
    if args.dask and not args.sweep:
        raise InputError("--dask needs --sweep")
    if args.sweep:
        from cdff_dev.campaign.sweep import run_sweep

        return run_sweep(args)
    with opened(args.log, args.calibration) as log:
        return _replay(args, log) if args.dfpc else _mission(args, log)


def _mission(args: argparse.Namespace, log: LogSource) -> int:
    """Replay a mission with all DFPCs of a profile; return the exit code."""
    from cdff_common.errors import InputError
    from cdff_common.interfaces.profile import load_profile
    from cdff_dev.mission_replay.command import replay_mission

    missing = [f"--{name}" for name in ("profile", "out") if getattr(args, name) is None]
    of_one_dfpc = [f"--{n}" for n in _OF_ONE_DFPC if getattr(args, n) is not None]
    if missing or of_one_dfpc or args.map or args.mask or args.model or args.tap or args.speed != "max":
        wrong = (
            f"{missing[0]} is missing"
            if missing
            else f"{[*of_one_dfpc, '--map, --mask, --model, --tap or --speed'][0]} is for --dfpc"
        )
        raise InputError(f"--requests: {wrong}; a mission takes --profile FILE --out DIR [--store DIR]")
    store = Path(args.store) if args.store else None
    summary = replay_mission(
        log, load_profile(args.profile, complete=True), Path(args.requests), Path(args.out), store, args.plot
    )
    if args.json:
        print(json.dumps(summary, sort_keys=True))
    else:
        for answer in summary["answers"]:
            request = answer["asked"]
            remark = answer.get("detail") or ", ".join(answer["delivered"]["differences"]) or "as asked"
            line = f"{request['type']} of {request['robot']}: {answer['answer']} ({remark})"
            print(f"{answer['at_s']:8.1f} s  {line}")
        print(
            f"{summary['mission']}: {summary['samples']} samples, {summary['gated']} withheld by the "
            f"modes of their sensors, {summary['stored']} products stored, {summary['answered']} of "
            f"{summary['requests']} requests answered, {summary['cpu_s']:.2f} s CPU"
        )
        for name, totals in summary["dfpcs"].items():
            for finding in totals["sensor_findings"]:
                print(f"{name}: {finding['what']}; {finding['remedy']}", file=sys.stderr)
    return 0


def _replay(args: argparse.Namespace, log: LogSource) -> int:
    """Replay a log with one DFPC; return the exit code."""
    import dataclasses

    from cdff_common.cli import key_values
    from cdff_common.clock import format_stamp
    from cdff_common.errors import ConfigurationError, InputError, RefusedError
    from cdff_common.interfaces.dfpc import DfpcContext, Sample
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.interfaces.registry import Registry
    from cdff_common.interfaces.yaml_file import read_mapping
    from cdff_common.progress import Progress
    from cdff_dev.compilation import compilation_notice
    from cdff_dev.play.log_part import LogPart
    from cdff_dev.replay.conditions import parse_condition
    from cdff_dev.replay.engine import paced, replay, samples_of
    from cdff_dev.replay.first_samples import file_ports, with_files, with_poses
    from cdff_dev.replay.tap import Tap
    from cdff_dev.replay.wiring import robot_of, wire, with_masks

    speed = _speed(args.speed)
    map_files = [text for text in args.map if "=" not in text]
    if len(map_files) > 1:
        raise InputError(f"--map: files {', '.join(map_files)}, expected one")
    map_file = map_files[0] if map_files else None
    mapping = key_values([text for text in args.map if "=" in text], "--map", "PORT=STREAM")
    streams = {name: info.type_name for name, info in log.streams.items()}
    robot = robot_of(streams, args.robot)
    dfpc = Registry.default().make_dfpc(args.dfpc)
    context, entry, implementation = DfpcContext(robot), None, args.implementation
    parameters: dict[str, Any] = {}
    if args.profile:
        profile_robot = load_profile(args.profile, complete=True).robot(robot)
        entry = profile_robot.dfpc(dfpc.name)
        context, parameters = profile_robot.context(entry), dict(entry.parameters)
        implementation = implementation or entry.implementation
    if args.seed is not None:
        context = dataclasses.replace(context, seed=args.seed)
    if args.mask:
        context = with_masks(context, args.mask)
    if args.config:
        parameters.update(read_mapping(Path(args.config)))
    with compilation_notice(dfpc.name):
        dfpc.configure(parameters, context, implementation)
    wired = wire(
        dfpc.description,
        streams,
        robot,
        mapping,
        entry,
        file_ports(args.model, args.guess, map_file, args.poses),
    )
    outputs = tuple(port.attribute for port in dfpc.description.output_ports)
    until = parse_condition(args.until, outputs) if args.until else None
    tap = Tap(args.tap, (*wired, *outputs), partial(print, file=sys.stderr if args.json else sys.stdout))
    part: LogSource = log
    if args.start is not None or args.duration is not None:
        part = LogPart(log, list(wired.values()), args.start or "0", args.duration)
    progress = Progress(sum(part.streams[s].count for s in wired.values()), "samples")

    def on_sample(sample: Sample) -> None:
        tap.on_sample(sample)
        progress.advance()

    samples = with_poses(samples_of(part, wired, robot), dfpc.description, args.poses)
    summary = replay(
        dfpc,
        paced(with_files(samples, dfpc.description, args.model, args.guess, map_file), speed),
        Path(args.out) if args.out else None,
        on_sample,
        tap.on_product,
        until,
        args.plot,
    )
    progress.close()
    if args.json:
        print(json.dumps(summary, sort_keys=True))
    else:
        print(
            f"{dfpc.name}: {summary['samples']} samples, {summary['outputs']} outputs, "
            f"{summary['degraded']} degraded, {summary['failed']} failed, {summary['dropped']} dropped, "
            f"{summary['cpu_s']:.2f} s CPU"
        )
        if (stopped := summary["stopped"]) is not None:
            reasons = ", ".join(stopped["reasons"]) or "no reasons"
            stamp = format_stamp(stopped["t1_ns"])
            print(f"stopped by {stopped['condition']} at {stamp}: {stopped['status']}, {reasons}")
    for finding in summary["sensor_findings"]:
        print(f"{finding['kind']}: {finding['what']}; {finding['remedy']}", file=sys.stderr)
    if 0 < summary["errors"] < summary["samples"]:
        print(f"{summary['errors']} samples were refused; the last: {summary['last_error']}", file=sys.stderr)
    if not summary["samples"]:
        raise ConfigurationError(f"{args.log}: no sample reached {dfpc.name}")
    if summary["errors"] == summary["samples"]:
        raise RefusedError(f"{dfpc.name}: every sample was refused; the last: {summary['last_error']}")
    if summary["outputs"] and summary["failed"] == summary["outputs"]:
        raise RefusedError(f"{dfpc.name}: every output is FAILED; the last: {summary['last_failure']}")
    return 0


def _speed(text: str) -> float | None:
    """Return the factor of ``--speed``; None for max."""
    from cdff_common.errors import InputError

    if text == "max":
        return None
    try:
        speed = float(text)
    except ValueError:
        speed = math.nan
    if not 0 < speed < 1e6:
        raise InputError(f"--speed {text!r}: expected a factor above 0 or max")
    return speed
