# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from cdff_common.interfaces.registry import Registry
from cdff_dev.generate.asn1_model import model_reader
from cdff_dev.genom3.component import genom3_files
from cdff_dev.genom3.idl import identifier, idl_text

OMNIIDL = Path(__file__).resolve().parents[4] / "build" / "rock-peers" / "bin" / "omniidl"


def test_a_component_has_the_ports_and_operations_of_its_dfpc() -> None:
    gen = genom3_files(Registry.default().dfpc("lidar_slam"))["lidar_slam.gen"]
    assert re.findall(r"port in asn1::bitstream (\w+);", gen) == ["scan", "odometry", "map"]
    # odometry is an input and an output; the ports of a component share one scope
    outputs = ["pose", "odometry_out", "trajectory", "graph", "cloud"]
    assert re.findall(r"port out asn1::bitstream (\w+);", gen) == outputs
    assert 'activity get_map(in double voxel_m = 0: "Edge of the voxels' in gen
    assert "codel <start> get_trajectory_start(in t0_ns, in t1_ns, out result) yield ether;" in gen
    assert '#include "lidar_slam.idl"' in gen
    assert gen.count("{") == gen.count("}")


def test_names_of_all_components_are_unique_in_their_scope() -> None:
    for package in Registry.default().dfpcs.values():
        gen = genom3_files(package.description)[f"{package.description.folder}.gen"]
        ports = re.findall(r"port (?:in|out) asn1::bitstream (\w+);", gen)
        assert len(ports) == len(set(ports))
        expected = len(package.description.input_ports) + len(package.description.output_ports)
        assert len(ports) == expected


def test_lists_have_their_bounds_and_keywords_are_escaped() -> None:
    idl = idl_text(["Pointcloud", "PoseGraph"], "test")
    assert "typedef double Position_t[3];" in idl
    assert "typedef string<256> T_String_t;" in idl
    assert re.search(r"sequence<\w+, 400000>", idl)
    assert "typedef boolean TransformWithCovariance_Metadata_dataEstimated_t[7];" in idl
    assert idl.index("struct Time_t") < idl.index("struct PointCloud_Metadata_t")
    assert (identifier("fixed"), identifier("Union"), identifier("ref-time")) == (
        "_fixed",
        "_Union",
        "ref_time",
    )


@pytest.mark.skipif(not OMNIIDL.is_file(), reason="omniidl is not installed: run make peers")
def test_omniidl_compiles_the_idl_of_all_types(tmp_path: Path) -> None:
    names = list(model_reader().declarations)
    assert len(names) > 157
    path = tmp_path / "all.idl"
    path.write_text(idl_text(names, "all"))
    command = [str(OMNIIDL), "-bpython", f"-C{tmp_path}", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    stub = next(tmp_path.glob("*_idl.py")).read_text()
    assert all(f"cdff/{name.replace('-', '_')}_t:1.0" in stub for name in names)
    path.write_text(idl_text(names, "all").replace("typedef double T_Double_t;", "typedef duble T_Double_t;"))
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode != 0  # the check finds faults
