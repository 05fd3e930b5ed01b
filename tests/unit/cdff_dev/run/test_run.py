# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff run`` reads input files, and writes output files and outputs.json, for any DFN and DFPC."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from cdff_common.cli import run_safely
from cdff_common.errors import CdffError, ConfigurationError, InputError
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.geotiff import read_map
from cdff_common.formats.image import read_image, write_png
from cdff_common.formats.npz import read_npz, write_npz
from cdff_common.formats.ply import read_ply, write_ply
from cdff_common.geometry import se3
from cdff_common.interfaces.description import Port
from cdff_dev.run import commands
from cdff_dev.run.arrays import read_array
from cdff_dev.run.inputs import read_inputs, read_sequence
from cdff_dev.run.parameters import parameters
from tests.support import surfaces

T_TRUE = se3.exp_se3([0.3, -0.2, 0.1, 0.01, 0.02, 0.05])


def cdff_run(*arguments: str | Path) -> int:
    parser = argparse.ArgumentParser()
    commands.register(parser.add_subparsers())
    parsed = parser.parse_args(["run", *map(str, arguments)])
    return run_safely(lambda: int(parsed.run(parsed)))


def ply(path: Path, points: surfaces.Points) -> Path:
    path.write_bytes(write_ply(CloudArrays.of(points)))
    return path


def report_of(folder: Path) -> Any:
    return json.loads((folder / "outputs.json").read_text())


def test_a_dfpc_writes_a_pose_in_the_documented_form(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = ply(tmp_path / "a", surfaces.terrain(rng))
    model = ply(tmp_path / "b", se3.transform_points(se3.inverse(T_TRUE), surfaces.terrain(rng)))
    np.savetxt(tmp_path / "guess.txt", np.eye(4))
    inputs = [f"scene={scene}", f"model={model}", f"guess={tmp_path / 'guess.txt'}"]
    assert cdff_run("icp_localisation", *inputs, "--out", tmp_path / "out") == 0
    report = report_of(tmp_path / "out")
    assert set(report) == {"outputs", "quality", "wall_s", "cpu_s"}
    assert report["quality"]["status"] == "OK"
    value = report["outputs"]["pose"]["value"]
    assert set(value) == {"parent", "child", "stamp_ns", "T", "covariance", "covariance_kind"}
    assert (value["parent"], value["child"], value["covariance_kind"]) == ("scene", "model", "calibrated")
    np.testing.assert_allclose(np.array(value["T"]), T_TRUE, atol=0.01)
    assert np.array(value["covariance"]).shape == (6, 6)
    assert json.loads((tmp_path / "out" / report["outputs"]["pose"]["file"]).read_text()) == value


def test_a_refusal_exits_with_3_and_writes_no_value(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, model = ply(tmp_path / "a", surfaces.plane(rng)), ply(tmp_path / "b", surfaces.plane(rng))
    code = cdff_run("icp_localisation", f"scene={scene}", f"model={model}", "--out", tmp_path, "--json")
    report = report_of(tmp_path)
    assert code == 3
    assert json.loads(capsys.readouterr().out) == report
    assert report["quality"]["status"] == "FAILED"
    assert report["outputs"] == {"pose": {"type": "TransformWithCovariance"}}
    assert not (tmp_path / "pose.json").exists()


def test_a_dfn_is_found_by_its_infuse_name_and_takes_settings(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    target = ply(tmp_path / "t", surfaces.terrain(rng))
    source = ply(tmp_path / "s", se3.transform_points(se3.inverse(T_TRUE), surfaces.terrain(rng)))
    arguments = [
        f"source={source}",
        f"target={target}",
        "--implementation",
        "Gicp",
        "--set",
        "max_iterations=30",
    ]
    assert cdff_run("Registration3D", *arguments, "--out", tmp_path / "out") == 0
    report = report_of(tmp_path / "out")
    np.testing.assert_allclose(np.array(report["outputs"]["transform"]["value"]["T"]), T_TRUE, atol=0.01)
    assert report["outputs"]["converged"]["value"] is True


def test_the_infuse_name_of_an_implementation_selects_it(tmp_path: Path) -> None:
    image = np.full((40, 60), 30, np.uint8)
    image[:, 30:] = 200
    (tmp_path / "image").write_bytes(write_png(image))
    out = tmp_path / "out"
    assert cdff_run("CannyEdgeDetection", f"image={tmp_path / 'image'}", "--out", out) == 0
    edges = read_image(out / report_of(out)["outputs"]["image"]["file"])
    assert set(np.unique(edges)) == {0, 255}
    assert (edges[5:-5] > 0).any(axis=0).nonzero()[0].tolist() == [29]


def test_points_are_written_as_ply_and_other_arrays_as_npz(tmp_path: Path, rng: np.random.Generator) -> None:
    cloud = ply(tmp_path / "cloud", np.vstack([surfaces.terrain(rng, 500), [[100.0, 0.0, 0.0]]]))
    out = tmp_path / "out"
    assert (
        cdff_run(
            "point_cloud_filtering",
            f"points={cloud}",
            "--set",
            "max_range_m=50",
            "--implementation",
            "RangeFilter",
            "--out",
            out,
        )
        == 0
    )
    assert len(read_ply(out / "filtered_points.ply").points_m) == 500
    assert len(read_npz(out / "kept.npz")["kept"]) == 500


def test_a_map_is_written_as_geotiff_printed_in_words_and_drawn(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    cloud = ply(tmp_path / "cloud", surfaces.terrain(rng))
    out = tmp_path / "out"
    command = ["digital_elevation_mapping", f"cloud={cloud}", "--set", "resolution_m=0.5", "--out"]
    assert cdff_run(*command, out, "--plot", tmp_path / "map.png") == 0
    assert "cells of 0.5 m in" in capsys.readouterr().out
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    dem = read_map(out / report_of(out)["outputs"]["map"]["file"])
    assert dem.geometry.resolution_m == 0.5
    assert dem.layer("mean").shape == dem.geometry.shape
    assert cdff_run(*command, "-") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["outputs"]["map"]["value"]["metadata"]["resolution"] == 0.5


def test_several_clouds_make_one_map(tmp_path: Path, rng: np.random.Generator) -> None:
    points = surfaces.terrain(rng)
    is_left = points[:, 0] < np.median(points[:, 0])
    parts = {"scan10.ply": points[is_left], "scan9.ply": points[~is_left]}
    for name, part in parts.items():
        ply(tmp_path / name, part)
    options = ["--set", "resolution_m=0.5", "--out"]
    for name, clouds in (
        ("whole", [f"cloud={ply(tmp_path / 'whole.ply', points)}"]),
        ("parts", [f"cloud={tmp_path / 'scan9.ply'}", f"cloud={tmp_path / 'scan10.ply'}"]),
        ("pattern", [f"cloud={tmp_path}/scan*.ply"]),
    ):
        assert cdff_run("digital_elevation_mapping", *clouds, *options, tmp_path / name) == 0
    whole_map, in_parts, by_pattern = (
        read_map(tmp_path / name / report_of(tmp_path / name)["outputs"]["map"]["file"])
        for name in ("whole", "parts", "pattern")
    )
    counts = [float(np.nansum(dem.layer("count"))) for dem in (in_parts, whole_map)]
    assert counts[0] == pytest.approx(counts[1], rel=0.05)
    np.testing.assert_array_equal(by_pattern.layer("mean"), in_parts.layer("mean"))


def test_numbers_of_files_that_differ_are_refused(tmp_path: Path) -> None:
    cloud = str(ply(tmp_path / "cloud", np.ones((3, 3))))
    poses = str(tmp_path / "pose.tum")
    Path(poses).write_text("1.5 1 2 3 0 0 0 1\n", encoding="utf-8")
    ports = [Port(name="cloud", type="Pointcloud"), Port(name="poses", type="TransformWithCovariance")]
    with pytest.raises(InputError, match="cloud 3, poses 2; expected equal ones, or one"):
        read_sequence(ports, {"cloud": [cloud] * 3, "poses": [poses] * 2})
    batches = read_sequence(ports, {"cloud": [cloud] * 2, "poses": poses})
    assert [b["cloud"].stamp_ns for b in batches] == [1_500_000_000] * 2
    assert [b["poses"].parent_frame for b in batches] == ["site"] * 2
    batches = read_sequence(ports[:1], {"cloud": [cloud] * 3})
    assert [b["cloud"].stamp_ns for b in batches] == [0, 100_000_000, 200_000_000]


def test_a_disparity_image_is_written_as_float_tif(tmp_path: Path, rng: np.random.Generator) -> None:
    left = rng.integers(0, 255, (120, 300)).astype(np.uint8)
    for name, image in (("left", left), ("right", np.roll(left, -8, axis=1))):
        (tmp_path / name).write_bytes(write_png(image))
    out = tmp_path / "out"
    inputs = [f"left={tmp_path / 'left'}", f"right={tmp_path / 'right'}"]
    assert cdff_run("disparity_image", *inputs, "--out", out) == 0
    from cdff_common.formats.geotiff import read_bands

    bands, _, _ = read_bands(out / "disparity.tif")
    assert np.nanmedian(next(iter(bands.values()))) == pytest.approx(8.0, abs=0.1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["icp_localisation", "scene=cloud"], "model"),
        (["icp_localisation", "scene=cloud", "model=cloud", "sea=cloud"], "sea"),
        (["icp_localisation", "scene=cloud", "model=absent"], "absent"),
        (["icp_localisation", "scene=cloud", "model=noise"], "noise"),
        (["point_cloud_downsampling", "points=cloud", "points=cloud"], "twice"),
        (["no_such_thing", "scene=cloud"], "no_such_thing"),
        (["icp_localisation", "scene=cloud", "model=cloud", "--set", "bogus=1"], "bogus"),
        (["icp_localisation", "scene=cloud", "model=cloud", "--implementation", "Magic"], "Magic"),
        (["registration_3d", "source=cloud", "target=cloud", "guess=cloud"], "guess"),
    ],
)
def test_unusable_input_is_refused_in_one_line(
    tmp_path: Path,
    rng: np.random.Generator,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    ply(tmp_path / "cloud", surfaces.terrain(rng, 200))
    (tmp_path / "noise").write_bytes(bytes(range(250)))
    assert cdff_run(*arguments, "--out", tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_settings_precede_the_file_and_dots_address_nested_keys(tmp_path: Path) -> None:
    path = tmp_path / "config.yaml"
    path.write_text("min_overlap: 0.3\nregister_fine: {tukey: 2.0}\n")
    merged = parameters(str(path), ["min_overlap=0.5", "register_fine.max_iterations=5", "box=[1, 2]"])
    assert merged == {"min_overlap": 0.5, "register_fine": {"tukey": 2.0, "max_iterations": 5}, "box": [1, 2]}
    for bad in ("min_overlap", "=3", "min_overlap.x=3"):
        with pytest.raises(ConfigurationError):
            parameters(str(path), [bad])


def test_array_ports_accept_files_of_many_formats_and_plain_numbers(tmp_path: Path) -> None:
    points = np.arange(12.0).reshape(4, 3)
    (tmp_path / "a.npz").write_bytes(write_npz({"points": points, "other": np.zeros(1)}))
    (tmp_path / "a.csv").write_text("x,y,z\n" + "\n".join(",".join(map(str, row)) for row in points))
    (tmp_path / "a.json").write_text(json.dumps(points.tolist()))
    port = Port(name="points", type="float64[n,3]")
    for name in ("a.npz", "a.csv", "a.json"):
        np.testing.assert_array_equal(read_array(port, str(tmp_path / name)), points)
    assert read_array(Port(name="baselineM", type="float"), "0.12") == 0.12
    np.testing.assert_array_equal(read_array(Port(name="size", type="int64[2]"), "3,4"), [3, 4])
    with pytest.raises(InputError, match="shape"):
        read_array(Port(name="points", type="float64[n,2]"), str(tmp_path / "a.csv"))
    (tmp_path / "a.png").write_bytes(write_png(np.zeros((4, 5, 3), np.uint8)))
    assert read_array(Port(name="image", type="uint8[r,c]"), str(tmp_path / "a.png")).shape == (4, 5)


@pytest.mark.parametrize("text", ["1,,2", "1.2.3", "-"])
def test_malformed_numbers_are_refused_with_their_port(text: str) -> None:
    with pytest.raises(InputError, match="size="):
        read_array(Port(name="size", type="int64[2]"), text)


def test_a_log_whose_only_stream_has_no_samples_is_refused(tmp_path: Path) -> None:
    log = {"/mana/lidar.cloud.meta": {"type": "Pointcloud", "timestamps": []}, "/mana/lidar.cloud": []}
    (tmp_path / "empty.msg").write_bytes(msgpack.packb(log))
    with pytest.raises(InputError, match="expected one of Pointcloud with samples"):
        read_inputs([Port(name="cloud", type="Pointcloud")], {"cloud": str(tmp_path / "empty.msg")})


def test_a_json_file_with_a_number_is_not_a_pose(tmp_path: Path) -> None:
    (tmp_path / "number.json").write_text('{"value": 3.0}')
    with pytest.raises(CdffError, match=r"guess=.*number\.json: .*expected a TransformWithCovariance"):
        read_inputs(
            [Port(name="guess", type="TransformWithCovariance")], {"guess": str(tmp_path / "number.json")}
        )


def test_a_single_sensor_input_has_the_child_frame_and_stamp_of_the_pose(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    cloud = ply(tmp_path / "cloud", surfaces.terrain(rng, 200))
    (tmp_path / "pose.tum").write_text("12.5 1 2 3 0 0 0 1\n")
    ports = [
        Port(name="cloud", type="Pointcloud"),
        Port(name="poses", type="TransformWithCovariance", optional=True),
    ]
    values = read_inputs(ports, {"cloud": str(cloud), "poses": str(tmp_path / "pose.tum")})
    assert values["cloud"].frame == values["poses"].child_frame == "robot/base"
    assert values["cloud"].stamp_ns == values["poses"].stamp_ns == 12_500_000_000
    assert read_inputs(ports, {"cloud": str(cloud)})["cloud"].frame == "site"
