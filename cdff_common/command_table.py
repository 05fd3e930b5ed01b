# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Commands by purpose with one sentence each: ``cdff --help`` prints them without importing the commands."""

GROUPS: dict[str, dict[str, str]] = {
    "results from files": {
        "slam": "trajectory and map from the lidar or camera of a log, in one command",
        "vo": "trajectory and map from the stereo camera of a log, in one command",
        "dem": "elevation map from the lidar or stereo camera of a log, in one command",
        "run": "run one DFN or DFPC once, on files",
        "replay": "replay a log through a DFPC or a mission, without middleware, repeatably",
        "eval": "compare results with ground truth, or two runs with each other",
        "map": "maps of keyframes for visual_localisation, from images with known poses",
        "calibrate": "cameras, also with a hand, lidar or IMU, from a board; mounts and wheels from a drive",
        "log": "show, cut, merge, convert, compare and export logs",
        "world": "frames with covariances, and items, at a mission time",
        "view": "show logs, runs or the running system in a viewer",
    },
    "a running system": {
        "up": "run every service of a profile on this machine until Ctrl-C",
        "request": "request a product from the orchestrator",
        "call": "call an operation of a running DFPC: a route, a transform, a pin, …",
        "dpm": "search, fetch and delete products of a running DPM",
        "orchestrator": "jobs, catalogue and history of the orchestrator",
        "top": "live tables of streams, DFPCs, products and alarms of a running mission",
        "alarms": "alarms of all services of a running mission",
        "play": "publish the sensor samples of a log on the bus, with the mission clock",
        "record": "write the sensor samples and products on the bus to a log, until Ctrl-C",
        "service": "run one service in the foreground",
        "keys": "identities of a mission: certificates and access control",
    },
    "simulation and missions": {
        "demo": "run the whole system on recorded data and send it the requests of an autonomy framework",
        "simulate": "simulate a scenario to a log",
        "mission": "run a simulated mission with guided rovers or a guided servicer, and score it",
        "drive": "simulate rovers or a servicer that execute commands, and publish the mission clock",
    },
    "installation and development": {
        "doctor": "check that this machine can run the system, and advise on problems",
        "profile": "mission profiles that ship with the framework",
        "scenario": "simulated scenarios that ship with the framework",
        "dfn": "DFNs that are installed: descriptions, implementations, faults",
        "dfpc": "DFPCs that are installed: descriptions, implementations, faults",
        "new": "write the files of a new DFN, DFPC, profile or driver",
        "generate": "generate files from descriptions: types, interfaces, skeletons, pages, GenoM3, TASTE",
        "import": "profile from the interface view of a TASTE project",
        "check": "check a profile (--profile), or this checkout: descriptions, requirements",
        "completion": "print the completion script of a shell: bash, zsh or fish",
    },
}

SUMMARIES = {name: summary for commands in GROUPS.values() for name, summary in commands.items()}
