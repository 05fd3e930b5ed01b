# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point cloud files: round trips, and errors for malformed files."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import CodecError, InputError
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.format_detection import detect
from cdff_common.formats.kitti_bin import read_kitti_bin
from cdff_common.formats.las import read_las, write_las, write_laz
from cdff_common.formats.pcd import read_pcd, write_pcd
from cdff_common.formats.ply import read_ply, write_ply


@pytest.fixture
def cloud(rng: np.random.Generator) -> CloudArrays:
    return CloudArrays.of(
        rng.uniform(-50, 50, (100, 3)),
        rng.integers(0, 255, 100),
        rng.integers(0, 256, (100, 3)),
        rng.normal(size=(100, 3)),
    )


@pytest.mark.parametrize("ascii_text", [False, True])
def test_a_ply_file_survives_a_round_trip(cloud: CloudArrays, ascii_text: bool) -> None:
    data = write_ply(cloud, ascii_text=ascii_text, comments={"frame": "site"})
    reread = read_ply(data)
    assert detect(data) == "ply"
    np.testing.assert_allclose(reread.points_m, cloud.points_m, atol=1e-5)
    np.testing.assert_array_equal(reread.colors, cloud.colors)
    np.testing.assert_allclose(reread.intensity, cloud.intensity)
    np.testing.assert_allclose(reread.normals, cloud.normals, atol=1e-6)


def ply_of_names(*lines: str) -> bytes:
    """A PLY file of text with one vertex of four numbers."""
    return "\n".join(
        ["ply", "format ascii 1.0", "element vertex 1", *lines, "end_header", "1 2 3 4"]
    ).encode()


@pytest.mark.parametrize("names", [("z", "intensity", "x", "y"), ("Z", "Intensity", "X", "Y")])
def test_the_properties_of_a_ply_file_may_have_any_order_and_capitals(names: tuple[str, ...]) -> None:
    cloud = read_ply(ply_of_names(*(f"property float {name}" for name in names)))
    assert cloud.points_m.tolist() == [[3.0, 4.0, 1.0]]
    assert cloud.intensity is not None
    assert cloud.intensity.tolist() == [2.0]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (
            ["property float16 x"],
            "byte 38: header line 'property float16 x', expected property TYPE NAME, .*float",
        ),
        (["property float"], "byte 38: header line 'property float', expected property TYPE NAME,"),
        (["propertyy float x"], "byte 38: header line 'propertyy float x', expected one of ply, format"),
        (
            ["property float a", "property float b"],
            "has a, b, expected x, y and z among them: rename the columns",
        ),
        (["property float x", "property float x"], "element vertex has a repeated property"),
    ],
)
def test_a_wrong_header_of_a_ply_file_is_refused_with_offset_and_expectation(
    tmp_path: Path, lines: list[str], message: str
) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ply_of_names(*lines))
    with pytest.raises(CodecError, match=f"{path}: {message}"):
        read_ply(path)


def test_a_property_before_the_first_element_of_a_ply_file_is_refused() -> None:
    with pytest.raises(CodecError, match=r"byte 21: .*expected an element line before it"):
        read_ply(b"ply\nformat ascii 1.0\nproperty float x\nelement vertex 0\nend_header\n")


@pytest.mark.parametrize("layout", ["binary", "ascii"])
def test_a_pcd_file_survives_a_round_trip(cloud: CloudArrays, layout: str) -> None:
    data = write_pcd(cloud, layout=layout)
    reread = read_pcd(data)
    assert detect(data) == "pcd"
    np.testing.assert_allclose(reread.points_m, cloud.points_m, atol=1e-5)
    np.testing.assert_allclose(reread.intensity, cloud.intensity)
    if layout == "binary":
        np.testing.assert_array_equal(reread.colors, cloud.colors)


def test_a_las_file_keeps_millimetres_intensity_and_colour(cloud: CloudArrays) -> None:
    data = write_las(cloud)
    reread = read_las(data)
    assert detect(data) == "las"
    np.testing.assert_allclose(reread.points_m, cloud.points_m, atol=5.1e-4)
    np.testing.assert_array_equal(reread.intensity, cloud.intensity)
    np.testing.assert_array_equal(reread.colors, cloud.colors)


def test_a_kitti_scan_is_recognised_without_a_header(cloud: CloudArrays) -> None:
    data = np.column_stack([cloud.points_m, np.linspace(0, 1, 100)]).astype("<f4").tobytes()
    assert detect(data) == "bin"
    np.testing.assert_allclose(read_kitti_bin(data).points_m, cloud.points_m, atol=1e-5)


def test_a_compressed_pcd_is_read() -> None:
    xyz = np.arange(12, dtype="<f4").reshape(4, 3)
    columns = xyz.T.tobytes()  # column by column
    packed = b"".join(
        bytes([len(columns[i : i + 32]) - 1]) + columns[i : i + 32] for i in range(0, len(columns), 32)
    )
    head = b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 4\nHEIGHT 1\nDATA binary_compressed\n"
    data = head + struct.pack("<II", len(packed), len(columns)) + packed
    np.testing.assert_array_equal(read_pcd(data).points_m, xyz)


def compressed_pcd(packed: bytes, points: int) -> bytes:
    head = f"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {points}\nHEIGHT 1\nDATA binary_compressed\n"
    return b"VERSION .7\n" + head.encode() + struct.pack("<II", len(packed), 12 * points) + packed


def test_back_references_of_lzf_are_decompressed() -> None:
    packed = bytes([3]) + struct.pack("<f", 1.5) + bytes([0b110_00000, 3])  # four bytes, then the same twice
    np.testing.assert_array_equal(read_pcd(compressed_pcd(packed, 1)).points_m, [[1.5, 1.5, 1.5]])


@pytest.mark.parametrize(
    ("packed", "points"),
    [
        (bytes([0b100_00000, 1]), 2),
        (bytes([31]), 2),
        (bytes([1]) + b"ab", 2),
        (bytes([7]) + b"abcdefgh", 3),
        (bytes([15]) + b"abcdefghijklmnop", 2),
        (b"", 2),
        (bytes([7]) + b"abcdefgh", 1 << 28),
    ],
)
def test_malformed_lzf_is_refused(packed: bytes, points: int) -> None:
    with pytest.raises(CodecError, match="LZF"):
        read_pcd(compressed_pcd(packed, points))


def test_a_header_with_too_large_a_count_is_refused(cloud: CloudArrays) -> None:
    data = write_ply(cloud).replace(b"vertex 100", b"vertex 99999999999")
    with pytest.raises(CodecError, match="99999999999 vertices"):
        read_ply(data)
    with pytest.raises(CodecError, match="points"):
        read_pcd(write_pcd(cloud).replace(b"POINTS 100", b"POINTS 99999999999"))


def test_an_error_of_a_corrupt_file_names_its_path(tmp_path: Path) -> None:
    path = tmp_path / "broken.ply"
    path.write_bytes(
        b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nend_header\n"
    )
    with pytest.raises(CodecError, match=r"broken\.ply"):
        read_ply(path)
    with pytest.raises(InputError, match=r"absent\.ply"):
        read_ply(tmp_path / "absent.ply")
    (tmp_path / "noise").write_bytes(bytes(range(256)) * 3)
    with pytest.raises(CodecError, match="not recognised"):
        detect(tmp_path / "noise")


def test_laz_has_the_content_of_las_in_a_smaller_file(cloud: CloudArrays) -> None:
    data = write_laz(cloud)
    assert detect(data) == "las"
    assert len(data) < len(write_las(cloud))
    reread, plain = read_las(data), read_las(write_las(cloud))
    np.testing.assert_array_equal(reread.points_m, plain.points_m)
    for name in ("intensity", "colors"):
        np.testing.assert_array_equal(getattr(reread, name), getattr(plain, name))


def test_laspy_reads_a_written_laz_file(cloud: CloudArrays) -> None:
    import laspy

    reread = laspy.read(io.BytesIO(write_laz(cloud)))
    assert len(reread.points) == len(cloud.points_m)
    np.testing.assert_allclose(reread.xyz, cloud.points_m, atol=0.0006)


def test_a_las_file_wrongly_marked_as_compressed_is_refused(cloud: CloudArrays) -> None:
    data = bytearray(write_las(cloud))
    data[104] |= 0x80
    with pytest.raises(CodecError, match="not a readable LAZ"):
        read_las(bytes(data))


@pytest.mark.parametrize(
    ("name", "points"),
    [
        ("cdff_upstream/PointClouds/DevonIslandRoad1.ply", 201_028),
        ("cdff_upstream/PointClouds/bunny0.ply", 40_256),
        ("small_gicp_pair/source.ply", 69_792),
        ("cdff_upstream/PointClouds/SatelliteWithNormals.pcd", 992),
        ("kitti_velodyne/000094.bin", 121_618),
        ("isprs_terrain/samp11-utm.pcd", None),
        ("pcl_recognition/correspondence_grouping/milk.pcd", None),
    ],
)
def test_real_files_are_detected_and_read(
    real_data: Callable[[str], Path], name: str, points: int | None
) -> None:
    path = real_data(name)
    readers = {"ply": read_ply, "pcd": read_pcd, "bin": read_kitti_bin}
    cloud = readers[detect(path)](path)
    assert len(cloud.points_m) > 0
    assert points is None or len(cloud.points_m) == points
