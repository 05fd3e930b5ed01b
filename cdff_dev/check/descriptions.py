# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Check of descriptions against their code: ports, parameters, implementations, template fields, tests."""

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
from cdff_dev.generate.python_source import OPERATION_TYPES


def faults(root: Path, registry: Registry) -> list[str]:
    """Return all faults, one line each."""
    wrong = [f"{name}: did not load: {reason}" for name, reason in sorted(registry.failures.items())]
    for found in registry.dfns.values():
        wrong += dfn_faults(root, found.description, registry)
    for found in registry.dfpcs.values():
        wrong += dfpc_faults(root, found.description, registry)
    return wrong


def dfn_faults(root: Path, dfn: DfnDescription, registry: Registry) -> list[str]:
    """Return the faults of one DFN."""
    wrong = [
        f"template field {n!r} is empty"
        for n in ("doc", "output_ports", "cost", "tests")
        if not getattr(dfn, n)
    ]
    # A DFN without dependencies or diagnostics states that in its file.
    stated = ("dependencies", "diagnostics")
    wrong += [f"template field {n!r} is missing" for n in stated if n not in dfn.model_fields_set]
    wrong += _type_faults([*dfn.input_ports, *dfn.output_ports])
    wrong += _file_faults(root, dfn)
    wrong += [
        f"cost of {name!r}, which is no implementation" for name in set(dfn.cost) - set(dfn.implementations)
    ]
    strange = set(dfn.implementation_aliases.values()) - set(dfn.implementations)
    wrong += [f"alias of {name!r}, which is no implementation" for name in strange]
    for implementation in dfn.implementations:
        with _noting_error(wrong, f"implementation {implementation}"):
            node = registry.make_dfn(dfn.folder, implementation)
            node.configure()
            wrong += [
                f"parameter {name!r} of {implementation} has no description"
                for name, field in type(node).Config.model_fields.items()
                if not field.description
            ]
    return [f"DFN {dfn.folder}: {fault}" for fault in wrong]


def dfpc_faults(root: Path, dfpc: DfpcDescription, registry: Registry) -> list[str]:
    """Return the faults of one DFPC."""
    wrong = [
        f"template field {n!r} is empty"
        for n in ("doc", "control", "tests", "cost", "accuracy")
        if not getattr(dfpc, n)
    ]
    wrong += _type_faults([*dfpc.input_ports, *dfpc.output_ports])
    wrong += [f"item {m.item}: no type {m.type!r}" for m in dfpc.product_management if not _is_type(m.type)]
    wrong += [
        f"operation {o.name}: no type {o.output_type!r}"
        for o in dfpc.operations
        if o.output_type not in OPERATION_TYPES and not _is_type(o.output_type)
    ]
    wrong += _file_faults(root, dfpc)
    wrong += _product_faults(dfpc)
    for variant in dfpc.implementations:
        for slot in variant.dfns:
            with _noting_error(wrong, f"{variant.name}.{slot.dfn_id}"):
                registry.make_dfn(slot.name, slot.implementation).configure(dict(slot.parameters))
        with _noting_error(wrong, f"implementation {variant.name}"):
            registry.make_dfpc(dfpc.folder).configure(implementation=variant.name)
    return [f"DFPC {dfpc.folder}: {fault}" for fault in wrong]


@contextmanager
def _noting_error(wrong: list[str], what: str) -> Iterator[None]:
    """Add an error of the block to the faults."""
    try:
        yield
    except (CdffError, ImportError, AttributeError, TypeError) as error:
        wrong.append(f"{what}: {type(error).__name__}: {error}")


def _type_faults(ports: list[Any]) -> list[str]:
    wrong = [f"port {p.name}: no type {p.type_name!r}" for p in ports if not _fits(p)]
    return wrong + [f"port {p.name}: no doc" for p in ports if not p.doc]


def _product_faults(dfpc: DfpcDescription) -> list[str]:
    """Return a line for each output port whose type is not the one its product is stored as."""
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
    """Return the tests and benchmarks of a description that do not exist."""
    named = [("test", t.split("::")[0]) for t in description.tests]
    named += [("benchmark", c.benchmark) for c in description.cost.values() if c.benchmark]
    return [f"{kind} {path!r} does not exist" for kind, path in named if not (root / path).is_file()]
