# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps, clouds and poses of a real DPM are cropped, transformed and encoded as requested."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from cdff_common.clock import wall_ns
from cdff_common.errors import UnavailableError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import GridGeometry
from cdff_common.types import (
    ElevationMap,
    Map,
    NavigationMap,
    Pointcloud,
    PoseTrajectory,
    TransformWithCovariance,
)
from cdff_dev.ports import free_port
from tests.integration.conftest import ROOT, process_starter
from tests.integration.conftest import wait_until as eventually
from tests.support.orchestrated_products import NOW_NS, T_SITE_BASE, patch, put

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "orchestrator.yaml")


@pytest.fixture(scope="module")
def filled_endpoint(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A router, a DPM that holds products of two robots, and an orchestrator."""
    folder, endpoint = tmp_path_factory.mktemp("products"), f"tcp/127.0.0.1:{free_port()}"
    with process_starter(endpoint, folder) as spawn:
        spawn("services.router")
        spawn("services.dpm", "--profile", PROFILE, "--http", f"127.0.0.1:{free_port()}")
        spawn("services.orchestrator", "--profile", PROFILE)
        with Bus.open(endpoint, name="producer", wait_s=20) as bus:
            awaited_tokens = {keys.alive("mana", s) for s in ("dpm", "orchestrator")}
            eventually(lambda: awaited_tokens <= bus.alive(keys.alive("mana", "*")), 40, "start-up")
            put(bus, "dem", patch(0.0, 1.0, age_s=5000.0))
            put(bus, "dem", patch(1.0, 2.0, age_s=10.0))
            put(bus, "dem", patch(-2.0, 5.0, age_s=20.0), robot="minnie")
            for age_s in (6000, 0):
                base = TransformWithCovariance.from_transform(
                    T_SITE_BASE, parent="site", child="mana/base", stamp_ns=NOW_NS - age_s * 1_000_000_000
                )
                put(bus, "pose", base, child="mana/base")
            rng = np.random.default_rng(1)
            for seq, (low, high) in enumerate(((-5.0, 0.0), (0.0, 5.0))):
                x, y, z = rng.uniform(low, high, 4000), rng.uniform(-5, 5, 4000), rng.normal(size=4000)
                points = np.column_stack([x, y, z])
                cloud = Pointcloud.from_points(
                    points, frame="mana/base", stamp_ns=NOW_NS - seq * 1_000_000, intensity=np.arange(4000)
                )
                put(bus, "pointcloud", cloud, seq=seq)
            g = GridGeometry("site", 0.1, 0.0, 2.0, 20, 20)
            classes = np.ones(g.shape, np.uint8)
            classes[:, :10] = 0
            stamp_ns = NOW_NS
            put(
                bus,
                "navigation_map",
                NavigationMap.from_layers(g, {"class": classes}, t0_ns=stamp_ns, t1_ns=stamp_ns),
            )
            stamps = stamp_ns + np.arange(3) * 1_000_000
            trajectory = PoseTrajectory.from_arrays(
                stamps,
                [T_SITE_BASE.matrix] * 3,
                [T_SITE_BASE.covariance] * 3,
                parent="site",
                child="mana/base",
            )
            put(bus, "trajectory", trajectory, child="mana/base")
            yield endpoint


@pytest.fixture
def client(filled_endpoint: str) -> Iterator[Client]:
    with Client(filled_endpoint) as client:
        yield client


@pytest.mark.req("CDFF-SUP-021")
def test_a_dem_of_a_region_is_fused_from_patches_and_states_newest_and_oldest(client: Client) -> None:
    answer = client.request("dem", robot="mana", region="bbox:0,0,3,2", max_age_s=3600)
    assert isinstance(answer.value, ElevationMap)
    mean = answer.value.layer("mean")
    assert mean.shape == (40, 60)
    np.testing.assert_allclose(mean[:, :20], 1.0)
    np.testing.assert_allclose(mean[:, 20:40], 1.5)
    np.testing.assert_allclose(mean[:, 40:], 2.0)
    assert answer.delivered["coverage"] == pytest.approx(1.0)
    assert answer.delivered["resolution_m"] == 0.05
    assert 9 < answer.delivered["age_s"] < 3600 < answer.delivered["oldest_age_s"]
    assert len(answer.header.inputs) == 2


def test_cells_outside_a_round_region_are_not_delivered_and_finer_cells_are_aggregated(
    client: Client,
) -> None:
    answer = client.request("dem", robot="mana", region="circle:1,1,0.5", resolution_m=0.1)
    assert answer.delivered["resolution_m"] == pytest.approx(0.1)
    x, y = answer.value.geometry.centres_m()
    inside = np.hypot(x - 1, y - 1) <= 0.5
    assert np.isnan(answer.value.layer("mean")[~inside]).all()
    assert np.isfinite(answer.value.layer("mean")[inside]).all()


def test_a_coarser_resolution_than_requested_is_delivered_and_reported(client: Client) -> None:
    answer = client.request("dem", robot="mana", region="circle:1,1,0.5", resolution_m=0.01)
    assert answer.delivered["resolution_m"] == 0.05
    assert any("resolution" in d for d in answer.delivered["differences"])


def test_a_dem_of_any_robot_fuses_the_patches_of_all(client: Client) -> None:
    answer = client.request("dem", robot="any", region="bbox:-1,0,1,1", min_coverage=0.99)
    mean = answer.value.layer("mean")
    assert set(np.unique(mean)) == {np.float32(1.0), np.float32(5.0)}


def test_insufficient_coverage_is_unavailable_with_the_available_coverage(client: Client) -> None:
    with pytest.raises(UnavailableError, match=r"coverage: 0\.\d+, asked at least 0\.9"):
        client.request("dem", robot="mana", region="bbox:0,0,10,10", min_coverage=0.9, deadline_s=5)
    with pytest.raises(UnavailableError, match="age"):
        client.request("dem", robot="mana", region="bbox:0,0,3,2", max_age_s=1, deadline_s=5)


def test_a_dem_in_uper_format_is_an_infuse_map_in_any_frame(client: Client) -> None:
    plain = client.request("dem", robot="mana", region="bbox:0,0,3,2", format="uper")
    assert isinstance(plain.value, Map)
    pose = plain.value.metadata.pose_fixed_frame_map_frame
    np.testing.assert_allclose(pose.transform.matrix[:3, 3], [0.0, 2.0, 0.0])
    moved = client.request(
        "dem", robot="mana", region="bbox:0,0,3,2", region_frame="site", frame="mana/base", as_type="Map"
    )
    pose = moved.value.metadata.pose_fixed_frame_map_frame
    assert pose.parent_frame == "mana/base"
    corner = UncertainTransform.exact(se3.transform(np.eye(3), [0.0, 2.0, 0.0]))
    expected = T_SITE_BASE.inverse() @ corner
    np.testing.assert_allclose(pose.transform.matrix, expected.matrix, atol=1e-9)
    np.testing.assert_allclose(pose.transform.covariance, expected.covariance, atol=1e-9)
    with pytest.raises(UnavailableError, match="as=Map"):
        client.request("dem", robot="mana", region="bbox:0,0,3,2", region_frame="site", frame="mana/base")


def test_a_dem_as_geotiff_has_the_same_heights(client: Client) -> None:
    from cdff_common.formats.geotiff import read_map

    answer = client.request("dem", robot="mana", region="bbox:0,0,3,2", format="tif")
    uper = client.request("dem", robot="mana", region="bbox:0,0,3,2")
    np.testing.assert_array_equal(read_map(answer.data).layer("mean"), uper.value.layer("mean"))


def test_a_dem_by_reference_is_stored_by_the_dpm_and_fetched_by_id(client: Client) -> None:
    answer = client.request("dem", robot="mana", region="bbox:0,0,3,2", deliver="reference")
    inline = client.request("dem", robot="mana", region="bbox:0,0,3,2")
    assert answer.value == inline.value
    assert answer.delivered["coverage"] == inline.delivered["coverage"]
    assert client.get(answer.header.id).value == answer.value


def test_a_cloud_near_the_rover_is_merged_cropped_and_moved_to_the_site(client: Client) -> None:
    answer = client.request("pointcloud", robot="mana", region="near:mana/base,3", min_coverage=0.9)
    cloud = answer.value
    assert cloud.frame == "site"
    in_base = T_SITE_BASE.inverse().apply(cloud.points_m)
    assert (np.hypot(in_base[:, 0], in_base[:, 1]) <= 3.0 + 1e-9).all()
    assert in_base[:, 0].min() < -2
    assert in_base[:, 0].max() > 2
    assert len(answer.header.inputs) == 2
    assert answer.delivered["coverage"] >= 0.9
    assert np.array(answer.delivered["frame_covariance"]).shape == (6, 6)
    one = client.request("pointcloud", robot="mana", region="near:mana/base,3", frame="mana/base")
    assert len(one.header.inputs) == 1
    assert (np.hypot(*one.value.points_m[:, :2].T) <= 3.0 + 1e-9).all()


def test_a_large_cloud_is_sent_by_reference_transparently(client: Client) -> None:
    downsampled = client.request("pointcloud", robot="mana", region="near:mana/base,4", resolution_m=0.5)
    full = client.request("pointcloud", robot="mana", region="near:mana/base,4", deliver="reference")
    assert len(downsampled.value.points_m) < len(full.value.points_m)
    assert full.value.frame == "site"
    files = client.request("pointcloud", robot="mana", region="near:mana/base,4", format="ply")
    assert files.data.startswith(b"ply")
    later = client.request("pointcloud", robot="mana", region="near:mana/base,4")
    assert "orchestrator" not in later.delivered["source"], "a derived product was used as a source"


def test_a_navigation_map_is_cropped_to_the_region_and_unknown_cells_do_not_count_as_coverage(
    client: Client,
) -> None:
    answer = client.request("navigation_map", robot="mana", region="bbox:0,0,2,2")
    assert answer.delivered["coverage"] == pytest.approx(0.5)
    right = client.request("navigation_map", robot="mana", region="bbox:1,0,2,2", min_coverage=1.0)
    assert (right.value.layer("class") == 1).all()


def test_a_trajectory_in_the_rover_s_frame_is_transformed_with_its_covariance(client: Client) -> None:
    site = client.request("trajectory", robot="mana")
    assert isinstance(site.value, PoseTrajectory)
    assert site.value.parent_frame == "site"
    assert site.delivered["frame"] == "site"
    tum = client.request("trajectory", robot="mana", format="tum")
    assert len(tum.data.splitlines()) == 3


@pytest.mark.req("CDFF-SUP-020")
@pytest.mark.parametrize(
    ("example", "arguments", "expected"),
    [
        ("three_lines.py", ["mana"], ["'resolution_m': 0.05", "GridGeometry"]),
        (
            "raw_zenoh.py",
            [str(ROOT / "cdff_common" / "asn1"), "mana", "bbox:0,0,3,2"],
            [
                "mana/base in site: position [1.0, 2.0, 0.1]",
                "DEM of 40 x 60 cells of 0.05 m",
                "heights 1.0..2.0 m",
            ],
        ),
    ],
)
def test_an_example_prints_its_documented_output(
    filled_endpoint: str, example: str, arguments: list[str], expected: list[str]
) -> None:
    environment = {**os.environ, "CDFF_CONNECT": filled_endpoint, "PYTHONPATH": str(ROOT)}
    result = subprocess.run(
        [sys.executable, str(ROOT / "examples" / example), *arguments],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    for text in expected:
        assert text in result.stdout


def test_the_raw_zenoh_example_does_not_import_cdff() -> None:
    text = (ROOT / "examples" / "raw_zenoh.py").read_text(encoding="utf-8")
    assert "import cdff" not in text
    assert "from cdff" not in text


def test_a_plain_zenoh_query_with_default_options_gets_one_final_answer(filled_endpoint: str) -> None:
    import json

    import msgpack
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([filled_endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        replies = list(session.get("cdff/@v1/mana/orchestrator/@rpc/request?type=pose"))
        assert len(replies) == 1
        assert msgpack.unpackb(replies[0].ok.attachment.to_bytes())["final"] is True
        refused = list(session.get("cdff/@v1/mana/orchestrator/@rpc/request?type=pose;type=dem;request=abc"))
        assert len(refused) == 1
        body = msgpack.unpackb(refused[0].err.payload.to_bytes())
        assert (body["code"], body["retriable"]) == ("INVALID_ARGUMENT", False)


def test_the_command_line_requests_products_writes_files_and_lists_jobs_and_catalogue(
    filled_endpoint: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import json

    from cdff_common.cli import main
    from cdff_common.formats.geotiff import read_map

    monkeypatch.setenv("CDFF_CONNECT", filled_endpoint)
    out = tmp_path / "dem.tif"
    command = ["request", "dem", "--robot", "mana", "--region", "bbox:0,0,3,2", "--out", str(out), "--json"]
    assert main(command) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["delivered"]["coverage"] == pytest.approx(1.0)
    assert read_map(out.read_bytes()).layer("mean").shape == (40, 60)
    assert main(["request", "pose", "--robot", "mana", "--as", "RigidBodyState"]) == 0
    assert "RigidBodyState of mana" in capsys.readouterr().out
    assert main(["orchestrator", "jobs", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["jobs"][0]["state"] == "done"
    assert main(["orchestrator", "catalogue"]) == 0
    assert "troublemaker" in capsys.readouterr().out
    assert main(["request", "pose", "--robot", "mana", "--every-s", "0", "--count", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["type"] == "TransformWithCovariance"
    assert main(["request", "dem", "--robot", "mana", "--region", "circle:900,0,1", "--deadline-s", "3"]) == 1
    assert capsys.readouterr().err.startswith("cdff: no dem of mana as asked")


def test_a_scheduled_request_is_fulfilled_in_its_window(filled_endpoint: str) -> None:
    with Client(filled_endpoint) as client, Bus.open(filled_endpoint, name="producer", wait_s=20) as bus:
        start_ns = wall_ns() // 1000 * 1000 + 1_000_000_000
        window = (start_ns, start_ns + 30_000_000_000)
        scheduled = client.schedule("pose", *window, robot="minnie", max_sigma_m=0.5)
        assert scheduled["state"] == "scheduled"
        (job,) = client.scheduled("minnie")
        assert (job["job"], job["result"]) == (scheduled["request"], None)
        for _ in range(2):  # before and in the window
            base = TransformWithCovariance.from_transform(
                T_SITE_BASE, parent="site", child="minnie/base", stamp_ns=wall_ns() // 1000 * 1000
            )
            put(bus, "pose", base, robot="minnie", child="minnie/base")
            time.sleep(1.5)
        eventually(lambda: client.scheduled("minnie")[0]["state"] == "done", 20, "the scheduled pose")
        (product,) = client.scheduled("minnie")[0]["result"]["products"]
        assert window[0] <= client.get(product).value.stamp_ns <= window[1]
