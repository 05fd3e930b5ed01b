# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages are exchanged with C and C++ code that Debian's asn1c generates from the ASN.1 modules.

The programs of the tutorial are tested, too.
"""

from __future__ import annotations

import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from cdff_common import types
from cdff_common.asn1 import ASN1_DIR
from cdff_common.codecs import decode, encode
from cdff_common.geometry import UncertainTransform
from tests.support import messages
from tests.support.messages import random_message

_MISSING = [tool for tool in ("asn1c", "gcc", "g++", "ar") if shutil.which(tool) is None]
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        bool(_MISSING), reason=f"not installed: {', '.join(_MISSING)} (Debian: asn1c build-essential)"
    ),
]
_ROOT = Path(__file__).resolve().parents[2]
_EXAMPLES = _ROOT / "examples" / "exchange" / "c"
#: asn1c rounds some denormals.
_REALS = [v for v in messages.REALS if v == 0.0 or math.isnan(v) or abs(v) >= 2.2250738585072014e-308]
_TYPES = (
    "CorrespondenceMap2D",
    "CorrespondenceMap2DLarge",
    "Frame",
    "GroundAreas",
    "IMUSensors",
    "JointsTrajectory",
    "LaserScan",
    "LidarScan",
    "Map",
    "PointSequence",
    "Pointcloud",
    "PoseGraph",
    "PoseTrajectory",
    "RigidBodyState",
    "TransformWithCovariance",
    "VisualPointFeatureVector3D",
)


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Programs by the name of their source, built with the tutorial's script."""
    out = tmp_path_factory.mktemp("asn1c")
    programs = {}
    for source in (_EXAMPLES / "transform.c", _EXAMPLES / "cloud.cpp", Path(__file__).parent / "roundtrip.c"):
        command = ["bash", str(_EXAMPLES / "build.sh"), str(ASN1_DIR), str(out), str(source)]
        result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
        assert result.returncode == 0, result.stderr
        programs[source.name] = Path(result.stdout.strip())
    return programs


@pytest.mark.req("CDFF-CORE-051")
@pytest.mark.parametrize("name", _TYPES)
def test_a_message_survives_a_round_trip_through_c_code(
    build: dict[str, Path], name: str, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(messages, "REALS", _REALS)
    for _ in range(5):
        value = random_message(name, rng)
        data = encode(value, "uper", name)
        result = subprocess.run(
            [str(build["roundtrip.c"]), name], input=data, capture_output=True, check=False, timeout=60
        )
        assert result.returncode == 0
        assert decode(name, result.stdout) == value


def test_c_code_reads_long_lists_and_octets_in_fragments(
    build: dict[str, Path], rng: np.random.Generator
) -> None:
    values = [
        types.PointSequence(rng.normal(size=(20_000, 3))),
        types.Frame.from_image(rng.integers(0, 256, (480, 640), dtype=np.uint8), stamp_ns=0),
    ]
    for value in values:
        name = type(value).ASN1_NAME
        result = subprocess.run(
            [str(build["roundtrip.c"]), name],
            input=encode(value),
            capture_output=True,
            check=False,
            timeout=60,
        )
        assert result.returncode == 0
        assert decode(name, result.stdout) == value


def test_the_program_of_the_tutorial_reads_and_shifts_a_transform(
    build: dict[str, Path], tmp_path: Path
) -> None:
    T = np.eye(4)
    T[:3, 3] = [-12.281598, 0.1, 1e-300]
    pose = types.TransformWithCovariance.from_transform(
        UncertainTransform(T), parent="site", child="mana/base", stamp_ns=0
    )
    (tmp_path / "in.uper").write_bytes(encode(pose))
    command = [str(build["transform.c"]), str(tmp_path / "in.uper"), str(tmp_path / "out.uper")]
    result = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert result.stdout.splitlines()[:2] == ["parent site", "child mana/base"]
    assert [float(v) for v in result.stdout.split("translation ")[1].split()] == T[:3, 3].tolist()
    shifted = decode("TransformWithCovariance", (tmp_path / "out.uper").read_bytes())
    assert shifted.data.translation.tolist() == [-12.281598 + 1.0, 0.1, 1e-300]
    assert shifted.metadata == pose.metadata


def test_a_scan_written_in_cpp_is_read(build: dict[str, Path], tmp_path: Path) -> None:
    subprocess.run([str(build["cloud.cpp"]), str(tmp_path / "scan.uper")], check=True, timeout=60)
    scan = decode("LidarScan", (tmp_path / "scan.uper").read_bytes())
    assert scan.points_m.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]
    assert scan.frame == "mana/lidar"
    assert scan.time_offset_us.tolist() == [0, 50000, 100000]
    assert (scan.t0_ns, scan.t1_ns) == (1_600_000_000_000_000_000, 1_600_000_000_100_000_000)
