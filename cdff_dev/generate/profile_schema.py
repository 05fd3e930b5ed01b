# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""JSON Schemas of mission profiles and contact plans, with which editors complete and check these files."""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import BaseModel

from cdff_common.interfaces.contact_plan import ContactPlan
from cdff_common.interfaces.profile import Profile
from cdff_dev.generate.artefacts import Artefact
from cdff_dev.tree import Tree


def schemas(tree: Tree) -> list[Artefact]:
    """Return the artefacts ``profile.schema.json`` and ``contact_plan.schema.json``."""
    deploy = tree.root / "deploy"
    return [
        _artefact(deploy / "profiles" / "profile.schema.json", Profile),
        _artefact(deploy / "contact" / "contact_plan.schema.json", ContactPlan),
    ]


def _artefact(path: Path, model: type[BaseModel]) -> Artefact:
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema"} | model.model_json_schema()
    return Artefact(path, json.dumps(schema, indent=2, ensure_ascii=False) + "\n")
