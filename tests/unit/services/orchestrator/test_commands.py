# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common import cli
from cdff_common.errors import InputError, UnavailableError
from cdff_common.geometry import UncertainTransform
from cdff_common.types import TransformWithCovariance
from services.orchestrator.commands import format_of

STAMP_NS = 1_700_000_000_123_456_000


class ClientDouble:
    """Client double whose orchestrator has one job and one pose."""

    data = b"payload"
    value = TransformWithCovariance.from_transform(
        UncertainTransform.identity(), parent="site", child="mana/base", stamp_ns=STAMP_NS
    )

    def __init__(self, *_: object, **__: object) -> None: ...

    def __enter__(self) -> ClientDouble:
        return self

    def __exit__(self, *_: object) -> None: ...

    def request(self, *_: object, **__: object) -> ClientDouble:
        return self

    def standing(self, *_: object, **parameters: object) -> Iterator[ClientDouble]:
        assert parameters["every_s"] == 2.0
        assert parameters["t_ns"] == STAMP_NS
        while True:
            yield self

    robot = "mana"

    def summary(self) -> dict[str, Any]:
        return {
            "type": "TransformWithCovariance",
            "robot": "mana",
            "size": len(self.data),
            "header": {"t1_ns": STAMP_NS, "quality": {"status": "OK", "reasons": []}},
            "delivered": {"newest_ns": STAMP_NS},
        }

    def requests(self, *_: object, **__: object) -> dict[str, Any]:
        job = {"job": "a", "state": "done", "reason": "", "since_ns": STAMP_NS}
        job["request"] = {"type": "dem", "robot": "mana", "region": None}
        return {"jobs": [job], "scheduled": [], "leases": [], "unreachable": ["minnie"]}


@pytest.fixture
def client_double(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cdff_common.client.Client", ClientDouble)


@pytest.mark.parametrize(
    ("product", "name", "form"),
    [
        ("dem", "a.tif", "tif"),
        ("dem", "a.TIFF", "tif"),
        ("pose", "a.msgpack", "msgpack"),
        ("pose", "a.uper", "uper"),
        ("pose", "a.xml", "xer"),
        ("trajectory", "a.tum", "tum"),
        ("image", "a.png", "png"),
    ],
)
def test_the_file_suffix_selects_the_format(product: str, name: str, form: str) -> None:
    assert format_of(Path(name), product) == form


@pytest.mark.parametrize(("product", "name"), [("pose", "pose.png"), ("pose", "x"), ("dem", "x.ply")])
def test_an_unsupported_file_suffix_is_refused(product: str, name: str) -> None:
    with pytest.raises(InputError, match=r"is no format of a .*\.uper.*--format"):
        format_of(Path(name), product)


def test_a_pose_is_printed_in_words_and_whole_as_json(
    client_double: None, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert cli.main(["request", "pose"]) == 0
    assert "position: x 0.000, y 0.000, z 0.000 m" in capsys.readouterr().out
    assert cli.main(["request", "pose", "--json"]) == 0
    value = json.loads(capsys.readouterr().out)["value"]
    assert value["data"]["translation"] == [0.0, 0.0, 0.0]
    assert cli.main(["request", "pose", "--json", "--out", str(tmp_path / "pose.uper")]) == 0
    assert "value" not in json.loads(capsys.readouterr().out)


def test_json_output_has_stamps_as_decimal_strings(
    client_double: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["request", "pose", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["header"]["t1_ns"], document["delivered"]["newest_ns"]) == (str(STAMP_NS), str(STAMP_NS))
    assert cli.main(["orchestrator", "jobs", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["jobs"][0]["since_ns"] == str(STAMP_NS)
    assert cli.main(["orchestrator", "jobs"]) == 0
    shown = capsys.readouterr()
    assert "dem of mana" in shown.out
    assert "without answer: the orchestrator of minnie" in shown.err


def test_a_file_that_cannot_be_written_is_reported_in_one_line_with_exit_code_1(
    client_double: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["request", "pose", "--out", str(tmp_path / "none" / "x.tum")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "there is no folder" in line


def test_the_format_option_applies_to_any_file_name(client_double: None, tmp_path: Path) -> None:
    path = tmp_path / "pose.dat"
    assert cli.main(["request", "pose", "--format", "uper", "--out", str(path), "--json"]) == 0
    assert path.read_bytes() == ClientDouble.data


def test_a_standing_request_writes_a_line_for_each_answer(
    client_double: None, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["request", "pose", "--every-s", "2", "--count", "3", "--t", str(STAMP_NS), "--json"]
    assert cli.main(command) == 0
    assert len(capsys.readouterr().out.splitlines()) == 3


@pytest.mark.parametrize(
    "options", [["--count", "3"], ["--every-s", "1", "--count", "0"], ["--t", "yesterday"]]
)
def test_inconsistent_options_are_refused(
    client_double: None, options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["request", "pose", *options]) == 1
    assert options[-2] in capsys.readouterr().err


def test_a_malformed_region_is_reported_without_a_router(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(*_: object, **__: object) -> None:
        raise UnavailableError("no router")

    monkeypatch.setattr("cdff_common.client.Client", refused)
    assert cli.main(["request", "dem", "--region", "bbox:1,2"]) == 1
    assert "bbox:1,2" in capsys.readouterr().err


def test_standard_output_has_the_payload_only(
    client_double: None, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    assert cli.main(["request", "pose", "--out", "-"]) == 0
    captured = capfdbinary.readouterr()
    assert captured.out == b"payload"
    assert b"position: x 0.000" in captured.err


def test_a_plot_is_drawn_of_the_value(
    client_double: None, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    plot = tmp_path / "pose.svg"
    assert cli.main(["request", "pose", "--plot", str(plot)]) == 0
    assert "pose of mana" in plot.read_text()
    assert cli.main(["request", "dem", "--format", "tif", "--plot", str(plot)]) == 1
    assert "--format tif delivers a file" in capsys.readouterr().err
