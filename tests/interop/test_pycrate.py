# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of every type are exchanged with pycrate, an independent ASN.1 compiler and runtime.

pycrate is under the LGPL: only tests use it.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cdff_common.asn1 import asn1_files
from cdff_common.codecs import decode, encode
from tests.support import messages
from tests.support.messages import ALL, random_message

asnproc = pytest.importorskip(
    "pycrate_asn1c.asnproc", reason="pycrate is not installed (a development dependency)"
)

#: REALs that pycrate preserves: it reads NaN and -0 as 0.
_REALS = [v for v in messages.REALS if not np.isnan(v) and not (v == 0.0 and np.signbit(v))]
Find = Callable[[str], Any]


@pytest.fixture(scope="module")
def find(tmp_path_factory: pytest.TempPathFactory) -> Find:
    """A function that returns pycrate's object of a type by its ASN.1 name."""
    from pycrate_asn1rt.asnobj import ASN1Obj

    path = tmp_path_factory.mktemp("pycrate") / "generated_types.py"
    asnproc.compile_text([p.read_text(encoding="utf-8") for p in asn1_files()])
    asnproc.generate_modules(asnproc.PycrateGenerator, str(path))
    spec = importlib.util.spec_from_file_location("generated_types", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    # Without bound checks: pycrate compares the mantissa of a REAL, not its value, with the bounds.
    ASN1Obj._SAFE_BND = False
    modules = [m for m in vars(module).values() if hasattr(m, "_name_")]

    def by_name(name: str) -> Any:
        return next(getattr(m, name.replace("-", "_")) for m in modules if name in m._obj_)

    return by_name


@pytest.fixture(autouse=True)
def _reals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(messages, "REALS", _REALS)


@pytest.mark.req("CDFF-CORE-051")
@pytest.mark.parametrize("name", ALL)
def test_uper_messages_survive_a_round_trip_through_pycrate(
    find: Find, name: str, rng: np.random.Generator
) -> None:
    pycrate_type = find(name)
    for _ in range(3):
        value = random_message(name, rng)
        pycrate_type.from_uper(encode(value, "uper", name))
        assert decode(name, pycrate_type.to_uper(), "uper") == value


@pytest.mark.parametrize("name", ALL)
def test_ber_messages_survive_a_round_trip_through_pycrate(
    find: Find, name: str, rng: np.random.Generator
) -> None:
    pycrate_type = find(name)
    for _ in range(3):
        value = random_message(name, rng)
        pycrate_type.from_ber(encode(value, "ber", name))
        assert decode(name, pycrate_type.to_ber(), "ber") == value


@pytest.mark.parametrize("size", [16383, 16384, 65536, 70000])
def test_fragmented_messages_survive_a_round_trip_through_pycrate(find: Find, size: int) -> None:
    from cdff_common.types import Asn1Bitstream

    pycrate_type = find("Asn1Bitstream")
    value = Asn1Bitstream("Pointcloud", 0, (np.arange(size) % 251).astype(np.uint8))
    pycrate_type.from_uper(encode(value))
    assert decode("Asn1Bitstream", pycrate_type.to_uper()) == value
