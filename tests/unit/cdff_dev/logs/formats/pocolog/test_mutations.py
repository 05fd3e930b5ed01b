# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mutated pocolog files: typed errors only, with bounded memory."""

from __future__ import annotations

import logging
import resource
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.errors import CdffError
from cdff_dev.logs.formats.pocolog.log import PocologLog
from tests.support import pocolog_files as rock

_MUTATIONS = 2000
_MAX_GROWTH_MB = 300
T0_US = 1_600_000_000_000_000


def _logs() -> list[bytes]:
    """Small logs with compounds, containers, enumerations, compression, and an image."""
    state = dict.fromkeys(rock.JOINT_STATE.fields, 1.0)
    scan = {"time": rock.time(T0_US), "start_angle": 0.0, "angular_resolution": 0.1, "speed": 6.0}
    scan |= {"ranges": [1000, 1000], "minRange": 0, "maxRange": 5000, "remission": []}
    jpeg = cv2.imencode(".jpg", np.zeros((8, 8), np.uint8))[1].tobytes()
    depth = {"time": rock.time(T0_US), "timestamps": [], "vertical_size": 1, "horizontal_size": 2}
    depth |= {"vertical_projection": "POLAR", "horizontal_projection": "PLANAR", "vertical_interval": [0.0]}
    depth |= {"horizontal_interval": [0.1, 0.2], "distances": [1.0, 2.0], "remissions": []}
    samples = [
        (rock.JOINTS, {"names": ["a"], "elements": [state], "time": rock.time(T0_US)}),
        (rock.LASER_SCAN, scan),
        (rock.FRAME, rock.frame_value(jpeg, 8, 8, "MODE_JPEG", T0_US)),
        (rock.DEPTH_MAP, depth),
        (rock.SONAR_BEAM, rock.SONAR_BEAM_VALUE),
        (rock.TRAJECTORY, rock.TRAJECTORY_VALUE),
        (rock.Vector(rock.JOINTS), [{"names": ["b"], "elements": [state], "time": rock.time(T0_US)}]),
    ]
    logs = []
    for kind, value in samples:
        writer = rock.PocologWriter()
        writer.declare(0, "/task.port", kind)
        writer.sample(0, kind, value, T0_US)
        writer.sample(0, kind, value, T0_US, compress=True)
        logs.append(bytes(writer.data))
    return logs


def _mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """Change, insert or remove some bytes, half of them in the samples, or end the file."""
    data = bytearray(content)
    samples = content.index(b"</typelib>")
    for _ in range(rng.integers(1, 3)):
        at = int(rng.integers(samples, len(content))) if rng.random() < 0.5 else int(rng.integers(samples))
        match rng.integers(8):
            case 0:
                del data[at : at + int(rng.integers(1, 9))]
            case 1:
                data[at:at] = rng.bytes(int(rng.integers(1, 9)))
            case 2 | 3:
                data[at : at + 4] = rng.choice([b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f"])
            case 4 | 5:
                data[at : at + 1] = rng.choice([b"%c" % c for c in b'0123456789*[]<>/"'])
            case _:
                data[at : at + 1] = rng.bytes(1)
    return bytes(data[: rng.integers(len(data))] if rng.random() < 0.1 else data)


def test_mutations_give_typed_errors_with_bounded_memory(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.CRITICAL, "cdff_dev.logs")
    logs, path = _logs(), tmp_path / "log.0.log"
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    readable, faults = 0, []
    for seed in range(_MUTATIONS):
        path.write_bytes(_mutated(logs[seed % len(logs)], np.random.default_rng(seed)))
        try:
            log = PocologLog([path])
        except CdffError:
            continue
        with log:
            for name in log.streams:
                try:
                    readable += sum(1 for _ in log.samples([name]))
                except CdffError as error:
                    faults.append(str(error))
            for name in log.others.streams:
                try:
                    readable += sum(1 for _ in log.others.samples([name]))
                except CdffError as error:
                    faults.append(str(error))
    grown_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb) / 1024
    assert grown_mb < _MAX_GROWTH_MB
    assert all("log.0.log" in fault for fault in faults)
    assert min(readable, len(faults)) > _MUTATIONS // 10
