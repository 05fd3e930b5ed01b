# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wrong scenario files in orbit are refused with the field."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cdff_common.cli import main
from cdff_common.errors import ConfigurationError
from cdff_dev.simulate.orbit.scenario import OrbitScenario
from cdff_dev.simulate.orbit.world import OrbitWorld
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.scenario_files import load_any_scenario, scenario_names
from tests.unit.cdff_dev.simulate.orbit.conftest import small_scenario, small_values

CUBE = """v -0.5 -0.5 -0.5
v 0.5 -0.5 -0.5
v 0.5 0.5 -0.5
v -0.5 0.5 0.5
f 1 2 3
f 1 3 4
f 1 4 2
f 2 4 3
"""


def cube_file(folder: Path, scale: float) -> str:
    """Write a tetrahedron whose extent is ``scale`` to an OBJ file and return its path."""
    path = folder / "cube.obj"
    lines = []
    for line in CUBE.splitlines():
        kind, *values = line.split()
        numbers = [str(float(v) * scale) for v in values] if kind == "v" else values
        lines.append(" ".join([kind, *numbers]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"servicer__cameras__camera__colour": "red"}, r"servicer\.cameras\.camera\.colour"),
        ({"client__inertia_kg_m2": [1.0, 1.0, 3.0]}, r"client\.inertia_kg_m2.*at most the sum"),
        ({"client__inertia_kg_m2": [1.0, -1.0, 1.0]}, r"client\.inertia_kg_m2.*above 0"),
        ({"client__attitude__orientation_xyzw": [0.0, 0.0, 0.0, 2.0]}, r"orientation_xyzw.*unit quaternion"),
        ({"client__material": "chrome"}, r"client\.material.*foil_gold"),
        ({"orbit__eccentricity": 0.5}, r"orbit.*periapsis"),
        ({"servicer__path": [{"kind": "jump", "duration_s": 1.0}]}, r"servicer\.path\.0"),
        ({"servicer__path": []}, r"servicer\.path"),
        ({"servicer__cameras__camera__distortion": [0.1]}, r"servicer\.cameras\.camera.*coefficients"),
        ({"servicer__cameras__camera__distortion": [-9.0, 0.0, 0.0, 0.0]}, r"folds the image"),
        ({"servicer__lidars__lidar__near_m": 600.0}, r"servicer\.lidars\.lidar.*far_m"),
        ({"servicer__name": "client"}, r"names.*different"),
        (
            {"small_body": {"mu_m3_s2": 1.0, "sun_direction": [1, 0, 0], "sun_distance_au": 3.0}},
            r"either orbit or",
        ),
        ({"orbit": None}, r"either orbit or"),
        (
            {"servicer__cameras__camera__start_s": 20.0},
            r"servicer\.cameras\.camera\.start_s 20 is not before",
        ),
        (
            {
                "orbit": None,
                "lighting": None,
                "small_body": {"mu_m3_s2": 1.0, "sun_direction": [0, 0, 0], "sun_distance_au": 3.0},
            },
            r"small_body\.sun_direction.*expected a direction",
        ),
    ],
)
def test_a_wrong_value_is_refused_with_its_field(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        small_scenario(**changes)


def test_a_missing_mesh_is_refused_with_its_field() -> None:
    with pytest.raises(ConfigurationError, match=r"client\.mesh='nowhere\.obj': no such file.*satellite"):
        OrbitWorld(small_scenario(client__mesh="nowhere.obj"))


@pytest.mark.parametrize("position_m", [-0.9, -2.9])
def test_a_client_inside_the_near_plane_is_refused_with_sensor_and_time(position_m: float) -> None:
    path = [{"kind": "line", "to_m": [position_m, 0.0, 0.0], "duration_s": 20.0}]
    scenario = small_scenario(
        servicer__path=path, servicer__cameras__camera__near_m=2.5, servicer__lidars=None
    )
    with pytest.raises(
        ConfigurationError, match=r"servicer\.cameras\.camera\.near_m=2\.5: client is .* at \d+"
    ):
        OrbitWorld(scenario)


def test_a_path_through_the_client_is_refused_also_inside_of_it() -> None:
    path = [{"kind": "line", "to_m": [15.0, 0.05, 0.05], "duration_s": 20.0}]
    with pytest.raises(ConfigurationError, match=r"near_m=0\.1: client is 0 m from the sensor at \d+"):
        OrbitWorld(small_scenario(servicer__path=path, servicer__start_m=[-15.0, 0.05, 0.05]))
    with pytest.raises(ConfigurationError, match=r"servicer\.path: the servicer is 0 m .* expected at least"):
        OrbitWorld(small_scenario(servicer__start_m=[0.0, 0.0, 0.0]))


def test_an_impossible_transfer_is_refused_with_its_index() -> None:
    path = [
        {"kind": "hold", "duration_s": 5.0},
        {"kind": "transfer", "to_m": [0.0, 0.0, 9.0], "duration_s": 9e4},
    ]
    with pytest.raises(ConfigurationError, match=r"servicer\.path\.1: transfer"):
        OrbitWorld(small_scenario(servicer__path=path))


def test_a_scenario_in_orbit_is_refused_where_terrain_is_required(tmp_path: Path) -> None:
    file = tmp_path / "small.yaml"
    file.write_text(yaml.safe_dump(small_values()), encoding="utf-8")
    assert isinstance(load_any_scenario(str(file)), OrbitScenario)
    with pytest.raises(ConfigurationError, match="expected one on terrain"):
        load_scenario(str(file))
    file.write_text(yaml.safe_dump(small_values(kind="moon")), encoding="utf-8")
    with pytest.raises(ConfigurationError, match="kind='moon'"):
        load_any_scenario(str(file))


def test_the_command_refuses_a_wrong_scenario_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    file = tmp_path / "small.yaml"
    file.write_text(yaml.safe_dump(small_values(client__mesh="nowhere.obj")), encoding="utf-8")
    assert main(["simulate", str(file), "--out", str(tmp_path / "log"), "--workers", "0"]) == 1
    error = capsys.readouterr().err
    assert "mesh='nowhere.obj'" in error
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "log").exists()


@pytest.mark.slow
def test_every_shipped_scenario_in_orbit_has_held_out_seeds() -> None:
    scenarios = [load_any_scenario(name) for name in scenario_names()]
    in_orbit = [s for s in scenarios if isinstance(s, OrbitScenario)]
    assert in_orbit
    for scenario in in_orbit:
        assert len(set(scenario.held_out_seeds)) >= 3
        assert scenario.seed not in scenario.held_out_seeds


@pytest.mark.parametrize(
    ("scale", "unit", "words"), [(1200.0, "m", "with unit mm"), (1.0, "mm", "with unit m")]
)
def test_a_mesh_in_another_unit_is_refused_with_the_likely_one(
    tmp_path: Path, scale: float, unit: str, words: str
) -> None:
    mesh = cube_file(tmp_path, scale)
    with pytest.raises(ConfigurationError, match=rf"client\.mesh=.*largest extent.*client\.size_m.*{words}"):
        OrbitWorld(small_scenario(client__mesh=mesh, client__unit=unit))
    other = "mm" if unit == "m" else "m"
    assert (
        0.9
        < OrbitWorld(small_scenario(client__mesh=mesh, client__unit=other)).meshes["client"].extent_m
        < 1.3
    )


def test_a_file_that_is_no_mesh_is_refused_with_its_field(tmp_path: Path) -> None:
    (tmp_path / "text.obj").write_text("v 1 2 3\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"client\.mesh=.*text\.obj"):
        OrbitWorld(small_scenario(client__mesh=str(tmp_path / "text.obj")))


def glb(vertices: np.ndarray, triangles: np.ndarray) -> bytes:
    """Return a binary glTF file of one mesh."""
    blocks = [vertices.astype("<f4").tobytes(), triangles.astype("<u4").tobytes()]
    views = [
        {"buffer": 0, "byteOffset": 0, "byteLength": len(blocks[0])},
        {"buffer": 0, "byteOffset": len(blocks[0]), "byteLength": len(blocks[1])},
    ]
    low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
    points = {
        "bufferView": 0,
        "componentType": 5126,
        "count": len(vertices),
        "type": "VEC3",
        "min": low,
        "max": high,
    }
    corners = {"bufferView": 1, "componentType": 5125, "count": triangles.size, "type": "SCALAR"}
    scene = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": sum(map(len, blocks))}],
        "bufferViews": views,
        "accessors": [points, corners],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    binary = b"".join(blocks)
    chunks = (
        struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "glb"])
def test_meshes_are_read_in_every_format(tmp_path: Path, suffix: str) -> None:
    import open3d as o3d

    box = o3d.geometry.TriangleMesh.create_box(1.0, 2.0, 3.0)
    box.compute_triangle_normals()
    box.compute_vertex_normals()
    file = tmp_path / f"box.{suffix}"
    if suffix == "glb":
        file.write_bytes(glb(np.asarray(box.vertices), np.asarray(box.triangles)))
    else:
        assert o3d.io.write_triangle_mesh(str(file), box)
    world = OrbitWorld(small_scenario(client__mesh=str(file)))
    extents = np.ptp(world.meshes["client"].vertices_m, axis=0)
    np.testing.assert_allclose(extents, [1.0, 2.0, 3.0], atol=1e-6)
    assert len(world.meshes["client"].triangles) == 12


def test_the_digest_depends_on_the_mesh_file_and_not_on_the_description(tmp_path: Path) -> None:
    mesh = cube_file(tmp_path, 1.0)
    first = small_scenario(client__mesh=mesh).digest
    assert small_scenario(client__mesh=mesh, doc="other words").digest == first
    cube_file(tmp_path, 1.1)
    assert small_scenario(client__mesh=mesh).digest != first


def test_random_orientations_depend_on_the_seed_only() -> None:
    def orientation(seed: int) -> np.ndarray:
        changes = {"client__attitude__orientation_xyzw": "random", "seed": seed}
        return OrbitWorld(small_scenario(**changes)).motion.body_attitudes("client", np.zeros(1))[0]

    np.testing.assert_array_equal(orientation(5), orientation(5))
    assert np.abs(orientation(5) - orientation(6)).max() > 0.1
