# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The runner orders samples and gives each output its id and header."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces import registry
from cdff_common.interfaces.dfpc import Dfpc, DfpcContext, Sample
from cdff_common.interfaces.product import Status, product_id
from cdff_common.interfaces.registry import Registry
from cdff_common.types import ElevationMap, TransformWithCovariance
from cdff_core.runtime import Runner
from tests.support.dpm_products import elevation

PLUGIN = Path(__file__).parents[3] / "integration" / "plugin"


@pytest.fixture
def dfpc(monkeypatch: pytest.MonkeyPatch) -> Iterator[Dfpc]:
    monkeypatch.syspath_prepend(str(PLUGIN))
    result = Registry()
    result.scan("cdff_test_dfpcs", "dfpc")
    monkeypatch.setattr(registry, "_default_registry", lambda: result)
    dfpc = result.make_dfpc("troublemaker")
    dfpc.configure(context=DfpcContext(robot="mana"))
    yield dfpc
    sys.modules.pop("cdff_test_dfpcs", None)


def sample(stamp_ns: int, child: str = "mana/base", port: str = "poses", seq: int = 0) -> Sample:
    value = TransformWithCovariance.from_transform(
        UncertainTransform(np.eye(4)), parent="site", child=child, stamp_ns=stamp_ns
    )
    return Sample(port, stamp_ns, seq, value, id="in", frame="site", child=child)


def test_queued_samples_are_stepped_once(dfpc: Dfpc) -> None:
    runner = Runner(dfpc)
    runner.push(sample(1000))
    runner.push(sample(3000))
    assert [p.header.t1_ns for p in runner.drain()] == [1000, 3000]
    assert [p.header.seq for p in runner.drain()] == []


def test_an_older_or_repeated_sample_of_a_port_is_dropped_and_counted(dfpc: Dfpc) -> None:
    runner = Runner(dfpc)
    assert runner.push(sample(2000))
    assert not runner.push(sample(2000))
    assert not runner.push(sample(1000))
    assert runner.counters.late == 2


def test_a_sample_that_arrives_after_newer_ones_were_stepped_is_counted_as_out_of_order(dfpc: Dfpc) -> None:
    (port,) = dfpc.description.input_ports
    dfpc.description = dfpc.description.model_copy(
        update={"input_ports": (port.model_copy(update={"ordered": False}),)}
    )
    runner, counts = Runner(dfpc), []
    for stamp_ns, seq in ((3000, 0), (3000, 1), (1000, 2), (2000, 3), (5000, 4), (4000, 5)):
        runner.push(sample(stamp_ns, seq=seq))
        list(runner.drain())
        counts.append(runner.counters.out_of_order)
    assert counts == [0, 0, 1, 2, 2, 3]


def test_samples_after_a_backward_jump_of_the_mission_clock_are_in_order(dfpc: Dfpc) -> None:
    runner, hour_ns = Runner(dfpc), 3_600_000_000_000
    for stamp_ns in (hour_ns, 1000, 2000, 3000, 4000):
        runner.push(sample(stamp_ns))
        list(runner.drain())
    assert runner.counters.out_of_order == 0
    assert runner.counters.samples == 3


def test_the_oldest_time_is_that_of_the_next_sample(dfpc: Dfpc) -> None:
    runner = Runner(dfpc)
    assert (runner.oldest_ns, runner.pending) == (None, 0)
    runner.push(sample(1000))
    runner.push(sample(2000))
    assert (runner.oldest_ns, runner.pending) == (1000, 2)
    runner.step_one()
    assert (runner.oldest_ns, runner.pending) == (2000, 1)
    runner.step_one()
    assert (runner.oldest_ns, runner.step_one()) == (None, [])


def test_inputs_and_outputs_are_counted_by_port(dfpc: Dfpc) -> None:
    runner = Runner(dfpc)
    for stamp_ns in (1000, 2000):
        runner.push(sample(stamp_ns))
    list(runner.drain())
    assert runner.counters.to_dict()["samples_by_port"] == {"poses": 2}
    assert runner.counters.outputs_by_port == {"echo": 2}
    assert (runner.counters.samples, runner.counters.outputs, runner.counters.failed) == (2, 2, 0)


def test_a_requested_pose_has_the_header_of_its_frames_and_time(dfpc: Dfpc) -> None:
    header = Runner(dfpc).provenance("last", sample(5000).value)
    assert (header["frame"], header["child"]) == ("site", "mana/base")
    assert (header["t0_ns"], header["t1_ns"], header["seq"]) == (5000, 5000, 0)
    assert header["id"] == product_id("mana", "troublemaker", "last", 5000, 0, dfpc.config_hash)
    assert header["box_m"] == [0.0] * 6
    assert "resolution_m" not in header
    assert header["producer"].startswith("troublemaker/")
    assert header["config_hash"] == dfpc.config_hash


def test_a_requested_map_has_the_frame_resolution_and_interval_of_its_cells(dfpc: Dfpc) -> None:
    flat = elevation(1.0)
    stamped = ElevationMap.from_layers(flat.geometry, {"mean": flat.layer("mean")}, t0_ns=3000, t1_ns=7000)
    header = Runner(dfpc).provenance("map", stamped)
    assert (header["frame"], header.get("child"), header["resolution_m"]) == ("site", None, 0.1)
    assert (header["t0_ns"], header["t1_ns"]) == (3000, 7000)
    assert header["box_m"][:2] == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize("value", [3, {"count": 2}, sample(5000).value.transform])
def test_a_requested_value_without_frame_or_time_has_only_its_producer(dfpc: Dfpc, value: object) -> None:
    assert Runner(dfpc).provenance("count", value).keys() == {"producer", "config_hash"}


@pytest.mark.parametrize("given", [{"frame": "site"}, {"stamp_ns": 5000}, {"frame": "", "stamp_ns": 5000}])
def test_a_requested_value_needs_a_frame_and_a_time_for_a_header(
    dfpc: Dfpc, given: dict[str, object]
) -> None:
    value = SimpleNamespace(**given, extent_m=lambda: None)
    assert Runner(dfpc).provenance("part", value).keys() == {"producer", "config_hash"}


def test_a_requested_value_without_extent_has_no_box(dfpc: Dfpc) -> None:
    value = SimpleNamespace(frame="mana/base", stamp_ns=0, extent_m=lambda: None)
    header = Runner(dfpc).provenance("part", value)
    assert (header["frame"], header["t0_ns"], header["t1_ns"]) == ("mana/base", 0, 0)
    assert header.get("box_m") is None
    assert header.get("resolution_m") is None
    assert header.get("child") is None
    geometry = SimpleNamespace(frame="mana/odom", resolution_m=0.5)
    header = Runner(dfpc).provenance(
        "part", SimpleNamespace(geometry=geometry, stamp_ns=5000, extent_m=lambda: None)
    )
    assert (header["frame"], header["resolution_m"], header["t0_ns"]) == ("mana/odom", 0.5, 5000)


def test_an_unordered_port_accepts_older_samples_and_drops_repeated_ones(
    dfpc: Dfpc,
) -> None:
    (port,) = dfpc.description.input_ports
    dfpc.description = dfpc.description.model_copy(
        update={"input_ports": (port.model_copy(update={"ordered": False}),)}
    )
    runner = Runner(dfpc)
    stamps = [2000, 1000, 1000, 2000, 3000]
    assert [runner.push(sample(t)) for t in stamps] == [True, True, False, False, True]
    assert runner.push(sample(1000, seq=1))
    assert runner.counters.late == 2
    assert [p.header.t1_ns for p in runner.drain()] == [1000, 1000, 2000, 3000]


def test_a_port_accepts_samples_after_a_backward_jump_of_the_mission_clock(dfpc: Dfpc) -> None:
    runner, hour_ns = Runner(dfpc), 3_600_000_000_000
    assert runner.push(sample(hour_ns))
    assert [runner.push(sample(t)) for t in (1000, 2000, 3000, 4000)] == [False, False, True, True]
    assert [p.header.t1_ns for p in runner.drain()] == [3000, 4000, hour_ns]


def test_one_future_stamp_and_some_late_ones_do_not_reset_a_port(dfpc: Dfpc) -> None:
    runner, hour_ns = Runner(dfpc), 3_600_000_000_000
    assert runner.push(sample(hour_ns))
    for late in (1000, 2000):
        assert not runner.push(sample(late))
    assert runner.push(sample(hour_ns + 1000))
    assert not runner.push(sample(3000))


def test_samples_that_are_late_by_up_to_ten_seconds_never_reset_a_port(dfpc: Dfpc) -> None:
    runner, hour_ns, limit_ns = Runner(dfpc), 3_600_000_000_000, 10_000_000_000
    assert runner.push(sample(hour_ns))
    assert not any(runner.push(sample(hour_ns - limit_ns + 1000 * k)) for k in range(6))
    assert [runner.push(sample(hour_ns - limit_ns - 4000 + 1000 * k)) for k in range(3)] == [
        False,
        False,
        True,
    ]


def test_an_unordered_port_remembers_the_last_1024_samples(dfpc: Dfpc) -> None:
    (port,) = dfpc.description.input_ports
    dfpc.description = dfpc.description.model_copy(
        update={"input_ports": (port.model_copy(update={"ordered": False}),)}
    )
    runner = Runner(dfpc)
    assert all(runner.push(sample(5000, seq=k)) for k in range(1025))
    assert not runner.push(sample(5000, seq=1))
    assert runner.push(sample(5000, seq=0))


def test_a_replayed_log_is_accepted_again_by_an_unordered_port(dfpc: Dfpc) -> None:
    (port,) = dfpc.description.input_ports
    dfpc.description = dfpc.description.model_copy(
        update={"input_ports": (port.model_copy(update={"ordered": False}),)}
    )
    runner = Runner(dfpc)
    plays = [[runner.push(sample(k * 100_000_000, seq=k)) for k in range(340)] for _ in range(3)]
    assert [sum(play) for play in plays] == [340, 338, 340]


@pytest.mark.req("CDFF-SUP-015")
def test_an_output_has_a_deterministic_id_and_the_ids_of_its_inputs(dfpc: Dfpc) -> None:
    runner = Runner(dfpc)
    runner.push(sample(1000))
    (product,) = runner.drain()
    assert product.header.id == product_id("mana", "troublemaker", "echo", 1000, 0, dfpc.config_hash)
    assert product.header.inputs == ("in",)
    assert product.product == "pose"
    assert product.header.box_m == (0.0,) * 6


def test_an_error_of_the_dfpc_is_counted_and_the_next_sample_is_stepped(dfpc: Dfpc) -> None:
    runner = Runner(dfpc)
    runner.push(sample(1000, "trouble/refuse"))
    runner.push(sample(2000))
    assert len(list(runner.drain())) == 1
    assert runner.counters.errors == 1
    assert "refusal on command" in runner.counters.last_error


def test_an_unexpected_exception_propagates(dfpc: Dfpc) -> None:
    runner = Runner(dfpc)
    runner.push(sample(1000, "trouble/raise"))
    with pytest.raises(ZeroDivisionError):
        list(runner.drain())


@pytest.mark.req("CDFF-SUP-014")
def test_a_failed_output_has_no_value_and_is_counted(dfpc: Dfpc) -> None:
    runner = Runner(dfpc)
    runner.push(sample(1000, "trouble/fail"))
    (product,) = runner.drain()
    assert product.value is None
    assert product.header.quality.status is Status.FAILED
    assert runner.counters.failed == 1
    assert runner.counters.last_failure == ", ".join(product.header.quality.reasons) != ""


def test_an_unknown_port_is_refused(dfpc: Dfpc) -> None:
    with pytest.raises(ConfigurationError, match="no input port"):
        Runner(dfpc).push(sample(1000, port="clouds"))


def test_two_runs_yield_the_same_ids(dfpc: Dfpc) -> None:
    ids = []
    for _ in range(2):
        dfpc.reset()
        runner = Runner(dfpc)
        for stamp in (1000, 2000, 3000):
            runner.push(sample(stamp))
        ids.append([p.header.id for p in runner.drain()])
    assert ids[0] == ids[1]


@pytest.mark.req("CDFF-SUP-012")
def test_operations_accept_text_and_refuse_unknown_parameters(dfpc: Dfpc) -> None:
    assert dfpc.call("count", {"factor": "2"}) == 0
    with pytest.raises(InputError, match="factor='x'"):
        dfpc.call("count", {"factor": "x"})
    with pytest.raises(InputError, match="unknown parameter"):
        dfpc.call("count", {"facto": "1"})


def test_an_unlisted_implementation_is_refused(dfpc: Dfpc) -> None:
    with pytest.raises(ConfigurationError, match="expected one of Troublemaker"):
        dfpc.configure(implementation="Other")
    with pytest.raises(ConfigurationError, match="Known keys"):
        dfpc.configure({"speed": 1})
