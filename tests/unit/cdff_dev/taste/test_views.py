# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cdff_common.errors import InputError
from cdff_common.interfaces.registry import Registry
from cdff_dev.taste.aadl import MAX_CHARACTERS, Property, parse_view, value_of, view_text
from cdff_dev.taste.export import data_view, dfpc_view, taste_files, type_names
from cdff_dev.taste.types_used import used_types
from cdff_dev.taste.views import Connection, interface_packages, interface_view, read_interface_view

FILE = Path(__file__).parent / "transformer_iv.aadl"
TEXT = FILE.read_text()


def test_a_view_in_the_form_of_the_editor_is_read_with_its_functions_and_connections() -> None:
    view = read_interface_view(FILE)
    aligner, viewer = view.functions
    assert (aligner.name, aligner.language, viewer.language) == ("Aligner", "CPP", "C")
    pose_in, clock, aligned = aligner.interfaces
    assert (pose_in.kind, pose_in.deadline_ms, pose_in.parameters[0].encoding) == ("sporadic", 20.0, "UPER")
    assert (clock.kind, clock.period_ms, clock.parameters) == ("cyclic", 1000.0, ())
    assert aligned.parameters[0].type == "Base_samples_RigidBodyState"
    assert not aligned.is_provided
    assert view.connections == (Connection(("Aligner", "RI_aligned"), ("Viewer", "PI_show")),)
    assert view.data_view == "transformer_dv.aadl"


def test_a_view_that_is_read_and_written_is_equal_in_meaning() -> None:
    view = parse_view(TEXT, "view")
    text = view_text(view)
    assert text != TEXT
    assert parse_view(text, "view") == view
    assert parse_view(TEXT.replace("PROPERTIES", "properties").replace(" => ", "=>"), "view") == view
    functions = interface_view(view, "view")
    assert interface_view(parse_view(view_text(interface_packages(functions)), "view"), "view") == functions


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("Deadline => 20 ms", "Deadline => 21 ms"),
        ("=gnulinux", "=GNULINUX"),
        ("DataView::Base_samples_RigidBodyState { Taste", "DataView::Base_samples_Frame { Taste"),
        ("Viewer.PI_show -> Aligner", "Viewer.PI_other -> Aligner"),
        ("  flags : DATA", "  flag : DATA"),
        ("WITH Taste;", ""),
    ],
)
def test_another_meaning_is_not_equal(before: str, after: str) -> None:
    assert parse_view(TEXT.replace(before, after, 1), "view") != parse_view(TEXT, "view")


def test_values_are_read_without_quotes() -> None:
    properties = (Property("Taste::FS_Default_Value", '"a ""b"" c"'), Property("Size", "96 Bytes"))
    assert value_of(properties, "taste::fs_default_value") == 'a "b" c'
    assert value_of(properties, "Size") == "96 Bytes"
    assert value_of(properties, "other") is None


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("PUBLIC", "PUBLIK", r"view:3: found 'PUBLIK', expected 'public'"),
        ("END PI_clock;", "END PI_clok;", r"END PI_clok, expected END PI_clock"),
        ("Taste::Associated_Queue_Size => 1;", "Taste::Associated_Queue_Size 1;", "expected '=>'"),
        ("WITH DataView;", "WITH ?;", "found '\\?;', expected a word of AADL"),
        ("SYSTEM Aligner\n", "SYSTEMS Aligner\n", "expected a component"),
        ("1 sec", "1 fortnight", "time '1 fortnight', expected a number with ns, us, ms or sec"),
        (
            "Viewer.PI_show -> Aligner",
            "Viewer.PI_other -> Aligner",
            "names Viewer.PI_other, which no function",
        ),
        ("PROVIDES SUBPROGRAM ACCESS", "PROVIDES DATA ACCESS", "expected an interface"),
        ("sample : IN PARAMETER", "sample : PARAMETER", "expected IN PARAMETER DataView::TYPE"),
        ("SUBPROGRAM PI_clock\nEND PI_clock;", "", "its package has no such subprogram"),
    ],
)
def test_a_malformed_view_is_refused_with_what_was_expected(before: str, after: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        interface_view(parse_view(TEXT.replace(before, after, 1), "view"), "view")


def test_every_end_of_a_truncated_view_is_refused() -> None:
    for length in range(0, len(TEXT) - 30, 307):
        with pytest.raises(InputError, match="view"):
            interface_view(parse_view(TEXT[:length], "view"), "view")


def test_huge_and_foreign_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected at most"):
        parse_view("-" * (MAX_CHARACTERS + 1), "view")
    path = tmp_path / "x.aadl"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="cannot be read as text"):
        read_interface_view(path)
    with pytest.raises(InputError, match="expected the interface view of TASTE"):
        interface_view(data_view(used_types(["Time"])), "x_dv.aadl")


def test_all_dfpcs_have_an_interface_view_in_which_everything_is_connected() -> None:
    for package in Registry.default().dfpcs.values():
        view = dfpc_view(package.description, "x_dv.aadl")
        assert interface_view(parse_view(view_text(interface_packages(view)), "view"), "view") == view
        required = {(f.name, i.feature) for f in view.functions for i in f.interfaces if not i.is_provided}
        assert {c.required for c in view.connections} == required
        names = {i.feature for i in view.functions[0].interfaces}
        assert len(names) == len(view.functions[0].interfaces)
        assert {f"PI_{p.attribute}" for p in package.description.input_ports} <= names


def test_the_data_view_has_each_type_after_those_to_which_it_refers_with_its_file() -> None:
    description = Registry.default().dfpc("lidar_slam")
    files = taste_files(description)
    view = parse_view(files["lidar_slam_dv.aadl"], "view")
    assert view == data_view(used_types(type_names(description)))
    types = {c.name: c for c in view.packages[0].components if c.value("Source_Text")}
    names = list(types)
    assert names.index("Time") < names.index("LidarScan_Metadata") < names.index("LidarScan")
    assert {c.value("Source_Text") for c in types.values()} <= {f'("{name}")' for name in files}
    assert types["T_Double"].value("TASTE::ASN1_Basic_Type") == "aREAL"
    assert types["Position"].value("TASTE::ASN1_Basic_Type") == "aSEQUENCEOF"
    assert any(
        note.startswith("InputASN1FileChecksum:") and note.endswith(":pose.asn:") for note in view.notes
    )


@pytest.mark.parametrize(
    ("name", "message_bytes", "buffer_bytes"),
    [
        # The data views that ESROCOS published state these sizes for types with the same definition.
        ("T-Boolean", 1, 8),
        ("T-Int16", 8, 8),
        ("T-Int32", 8, 8),
        ("T-Double", 13, 16),
        ("Position", 39, 40),
        ("Array3D-depth-t", 4, 8),
        # Computed from the definitions: 8 + 4 bytes in UPER, two words in C; 256 bytes with their number.
        ("Time", 16, 16),
        ("T-String", 260, 264),
        ("Covariance", 36 * 13, 472),
    ],
)
def test_sizes_are_those_of_the_largest_form_rounded_to_eight(
    name: str, message_bytes: int, buffer_bytes: int
) -> None:
    used = used_types([name])[-1]
    assert (used.message_bytes, used.buffer_bytes) == (message_bytes, buffer_bytes)


def test_an_unknown_type_is_refused() -> None:
    with pytest.raises(InputError, match=r"type 'Nothing': expected an ASN\.1 type"):
        used_types(["Nothing"])


def test_functions_that_are_not_connected_refer_to_themselves() -> None:
    view = replace(read_interface_view(FILE), connections=())
    text = view_text(interface_packages(view))
    assert "REQUIRES SUBPROGRAM ACCESS interfaceview::IV::Aligner::RI_aligned.others" in text
