# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of descriptions with the code: ports, parameters, implementations, template fields, tests."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cdff_common.contract.products import product_type
from cdff_common.errors import CdffError
from cdff_common.interfaces.description import DfnDescription, DfpcDescription, Port
from cdff_common.interfaces.registry import Registry
from cdff_dev.check.calibration import calibration_faults
from cdff_dev.generate.python_source import OPERATION_TYPES


def faults(root: Path, registry: Registry) -> list[str]:
    """Return the faults of all descriptions, one line each."""
    found_faults = [f"{name}: did not load: {reason}" for name, reason in sorted(registry.failures.items())]
    for entry in registry.dfns.values():
        found_faults += dfn_faults(root, entry.description, registry)
    for entry in registry.dfpcs.values():
        found_faults += dfpc_faults(root, entry.description, registry)
    return found_faults


def dfn_faults(root: Path, dfn: DfnDescription, registry: Registry) -> list[str]:
    """Return the faults of one DFN."""
    found_faults = [
        f"template field {n!r} is empty"
        for n in ("doc", "output_ports", "cost", "tests")
        if not getattr(dfn, n)
    ]
    # A DFN without dependencies or diagnostics has empty lists in its file.
    stated_fields = ("dependencies", "diagnostics")
    found_faults += [
        f"template field {n!r} is missing" for n in stated_fields if n not in dfn.model_fields_set
    ]
    found_faults += _type_faults([*dfn.input_ports, *dfn.output_ports])
    found_faults += _file_faults(root, dfn)
    found_faults += [
        f"cost of {name!r}, which is no implementation" for name in set(dfn.cost) - set(dfn.implementations)
    ]
    unknown = set(dfn.implementation_aliases.values()) - set(dfn.implementations)
    found_faults += [f"alias of {name!r}, which is no implementation" for name in unknown]
    for implementation in dfn.implementations:
        with _recording_error(found_faults, f"implementation {implementation}"):
            node = registry.make_dfn(dfn.folder, implementation)
            node.configure()
            found_faults += [
                f"parameter {name!r} of {implementation} has no description"
                for name, field in type(node).Config.model_fields.items()
                if not field.description
            ]
    return [f"DFN {dfn.folder}: {fault}" for fault in found_faults]


def dfpc_faults(root: Path, dfpc: DfpcDescription, registry: Registry) -> list[str]:
    """Return the faults of one DFPC."""
    found_faults = [
        f"template field {n!r} is empty"
        for n in ("doc", "control", "tests", "cost", "accuracy")
        if not getattr(dfpc, n)
    ]
    found_faults += _type_faults([*dfpc.input_ports, *dfpc.output_ports])
    found_faults += [
        f"item {m.item}: no type {m.type!r}" for m in dfpc.product_management if not _is_type(m.type)
    ]
    found_faults += [
        f"operation {o.name}: no type {o.output_type!r}"
        for o in dfpc.operations
        if o.output_type not in OPERATION_TYPES and not _is_type(o.output_type)
    ]
    found_faults += _file_faults(root, dfpc)
    found_faults += _product_faults(dfpc)
    found_faults += calibration_faults(root, dfpc)
    for variant in dfpc.implementations:
        for slot in variant.dfns:
            with _recording_error(found_faults, f"{variant.name}.{slot.dfn_id}"):
                registry.make_dfn(slot.name, slot.implementation).configure(dict(slot.parameters))
        with _recording_error(found_faults, f"implementation {variant.name}"):
            registry.make_dfpc(dfpc.folder).configure(implementation=variant.name)
    return [f"DFPC {dfpc.folder}: {fault}" for fault in found_faults]


@contextmanager
def _recording_error(faults: list[str], subject: str) -> Iterator[None]:
    """Append an error of the block to the faults, instead of raising it."""
    try:
        yield
    except (CdffError, ImportError, AttributeError, TypeError) as error:
        faults.append(f"{subject}: {type(error).__name__}: {error}")


def _type_faults(ports: list[Any]) -> list[str]:
    found_faults = [f"port {p.name}: no type {p.type_name!r}" for p in ports if not _fits(p)]
    return found_faults + [f"port {p.name}: no doc" for p in ports if not p.doc]


def _product_faults(dfpc: DfpcDescription) -> list[str]:
    """Return a fault for each output port whose type differs from that in which its product is stored."""
    return [
        f"port {port.name}: a {port.product} is stored as {known.type_name}, not as {port.type_name}"
        for port in dfpc.output_ports
        if port.product is not None
        and (known := product_type(port.product, "product")).type_name not in (None, port.type_name)
    ]


def _fits(port: Port) -> bool:
    return not port.is_message or _is_type(port.type_name)


def _is_type(name: str) -> bool:
    types = importlib.import_module("cdff_common.types")
    return any(getattr(getattr(types, n), "ASN1_NAME", None) == name or n == name for n in types.__all__)


def _file_faults(root: Path, description: DfnDescription | DfpcDescription) -> list[str]:
    """Return a fault for each test and benchmark of a description that does not exist."""
    files = [("test", t.split("::")[0]) for t in description.tests]
    files += [("benchmark", c.benchmark) for c in description.cost.values() if c.benchmark]
    return [f"{kind} {path!r} does not exist" for kind, path in files if not (root / path).is_file()]
