# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lint, render and validate the Helm chart; run by the interpreter of ``build/helm-peers`` (``make peers``).

Standard input: a JSON list of values. Standard output: a JSON list of ``{"lint": […], "objects": […],
"problems": […], "error": text}``; ``problems`` are those of the schemas of Kubernetes.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import helm_python as helm
import kubernetes_validate
import yaml

CHART = Path(__file__).resolve().parents[2] / "deploy" / "helm" / "cdff"
KUBERNETES = ("1.30", "1.37")


def checked(values: dict[str, Any]) -> dict[str, Any]:
    """Return the findings and the objects of one set of values."""
    report: dict[str, Any] = {"lint": [], "objects": [], "problems": [], "error": ""}
    lint = helm.lint(CHART, values, strict=True)
    report["lint"] = [m["error"] for m in lint["messages"] if m["severity"] >= 2] + lint["errors"]
    try:
        with helm.Chart.load(CHART) as chart:
            chart.validate_schema(values)
            files = chart.render(values, name="mission", namespace="rovers")
    except helm.HelmError as error:
        report["error"] = str(error)
        return report
    for name, text in files.items():
        if not name.endswith(".txt"):
            report["objects"] += [document for document in yaml.safe_load_all(text) if document]
    for document in report["objects"]:
        for version in KUBERNETES:
            try:
                kubernetes_validate.validate(document, version, strict=True)
            except kubernetes_validate.ValidationError as error:
                name = f"{document['kind']}/{document['metadata']['name']}"
                report["problems"].append(f"{name} ({version}): {error}")
    return report


if __name__ == "__main__":
    json.dump([checked(values) for values in json.load(sys.stdin)], sys.stdout)
