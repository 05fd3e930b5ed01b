# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``python stac_validation.py URL GEOMETRY``: stac-api-validator with the schemas that pystac contains.

The validator reads schemas from the web. Those of STAC and GeoJSON are taken from the package pystac; those
of extensions are not checked, since no package contains them.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pystac
import pystac.validation.stac_validator as of_pystac
import stac_validator.utilities
from stac_api_validator.__main__ import main

SCHEMAS = Path(pystac.__file__).parent / "validation" / "jsonschemas"
original = stac_validator.utilities.fetch_and_parse_schema
original_of_pystac = of_pystac.JsonSchemaSTACValidator._get_schema


def schema(url: str) -> Any:
    """Return the schema of a URL."""
    if "stac-extensions" in url:
        return {}
    name = url.rstrip("#").rsplit("/", 1)[1]
    folder = SCHEMAS / ("geojson" if "geojson.org" in url else "stac-spec/v1.1.0")
    return json.loads((folder / name).read_text())


def schema_of_pystac(self: Any, url: str) -> Any:
    """Return the schema of an extension, or that which pystac contains."""
    return {} if "stac-extensions" in url else original_of_pystac(self, url)


for module in list(sys.modules.values()):
    if getattr(module, "fetch_and_parse_schema", None) is original:
        module.fetch_and_parse_schema = schema  # type: ignore[attr-defined]
of_pystac.JsonSchemaSTACValidator._get_schema = schema_of_pystac  # type: ignore[method-assign]
classes = ("core", "collections", "features", "item-search")
options = [option for name in classes for option in ("--conformance", name)]
sys.argv[1:] = ["--root-url", sys.argv[1], "--collection", "dem", "--geometry", sys.argv[2], *options]
main()
