# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The Helm chart: rendered, linted and validated against the schemas of Kubernetes; no cluster has run it."""

from __future__ import annotations

import json
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from cdff_common.interfaces.profile import load_profile
from services.supervisor.plan import plan

ROOT = Path(__file__).resolve().parents[2]
CHART = ROOT / "deploy" / "helm" / "cdff"
PEER = ROOT / "build" / "helm-peers" / "bin" / "python"
PROFILES = sorted(path.stem for path in (ROOT / "deploy" / "profiles").glob("*.yaml"))
SERVER = {
    "url": "postgresql+psycopg://cdff@database/mission?payloads=s3://mission/payloads",
    "secret": "store",
}
IMAGES = {
    "services.router": "cdff-router",
    "services.dpm": "cdff-dpm",
    "services.orchestrator": "cdff-orchestrator",
    "services.icu": "cdff-icu",
    "services.dfpc_host": "cdff-dfpc-host",
    "services.map_merging": "cdff-dfpc-host",
}


def profile_text(name: str) -> str:
    return (ROOT / "deploy" / "profiles" / f"{name}.yaml").read_text(encoding="utf-8")


def values_of(name: str) -> dict[str, Any]:
    return {"profile": profile_text(name), "profileFiles": {"rover_mast.urdf": "<robot name='mast'/>"}}


DEMO = values_of("rover_traverse")
CASES: dict[str, dict[str, Any]] = {
    **{name: values_of(name) for name in PROFILES},
    "server": DEMO
    | {
        "dpm": {
            "store": SERVER,
            "workers": {"replicas": 3},
            "httpKeysSecret": "keys",
            "hosts": ["dpm.example"],
        },
        "hosts": {"resourcesOf": {"mana_mapping": {"limits": {"memory": "4Gi"}}}},
        "podDisruptionBudget": {"protectSingle": True},
        "networkPolicy": {
            "routerFrom": [{"ipBlock": {"cidr": "192.0.2.0/24"}}],
            "storeTo": [{"to": [{"ipBlock": {"cidr": "198.51.100.7/32"}}], "ports": [{"port": 5432}]}],
        },
    },
    "ground": DEMO | {"scopes": ["ground"]},
    "open": DEMO | {"identities": {"enabled": False}, "dpm": {"httpKeysSecret": "keys"}},
    "no profile": {},
    "no YAML": {"profile": "name: ["},
    "unknown scope": DEMO | {"scopes": ["nano"]},
    "unprotected": DEMO | {"identities": {"enabled": False}},
    "workers of an embedded store": DEMO | {"dpm": {"workers": {"replicas": 2}}},
    "unknown value": DEMO | {"router": {"replicas": 2}},
    "wrong type": DEMO | {"dpm": {"workers": {"replicas": "two"}}},
    "wrong quantity": DEMO | {"dpm": {"storage": {"size": "20 GB"}}},
}


@cache
def _reports() -> dict[str, dict[str, Any]]:
    result = subprocess.run(
        [str(PEER), str(ROOT / "tests" / "support" / "render_chart.py")],
        input=json.dumps(list(CASES.values())),
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert result.returncode == 0, result.stderr
    return dict(zip(CASES, json.loads(result.stdout), strict=True))


@pytest.fixture
def reports() -> dict[str, dict[str, Any]]:
    """The report of ``tests/support/render_chart.py`` for each case."""
    if not PEER.exists():
        pytest.skip("helm-python-sdk and kubernetes-validate are not installed; run `make peers`")
    return _reports()


def objects(report: dict[str, Any], kind: str) -> dict[str, dict[str, Any]]:
    assert report["error"] == ""
    return {o["metadata"]["name"]: o for o in report["objects"] if o["kind"] == kind}


def pods(report: dict[str, Any]) -> dict[str, dict[str, Any]]:
    both = objects(report, "StatefulSet") | objects(report, "Deployment")
    return {name.removeprefix("mission-"): o["spec"]["template"]["spec"] for name, o in both.items()}


def test_the_values_of_the_chart_satisfy_its_schema() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((CHART / "values.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft7Validator.check_schema(schema)
    jsonschema.validate(yaml.safe_load((CHART / "values.yaml").read_text(encoding="utf-8")), schema)


@pytest.mark.parametrize("case", [*PROFILES, "server", "ground", "open"])
def test_the_chart_passes_lint_and_all_objects_satisfy_the_schemas_of_kubernetes(
    reports: dict[str, dict[str, Any]], case: str
) -> None:
    report = reports[case]
    assert (report["lint"], report["error"], report["problems"]) == ([], "", [])
    assert report["objects"]


@pytest.mark.parametrize("name", PROFILES)
def test_the_chart_has_the_processes_that_the_supervisor_starts(
    reports: dict[str, dict[str, Any]], name: str, tmp_path: Path
) -> None:
    path = ROOT / "deploy" / "profiles" / f"{name}.yaml"
    specs = plan(load_profile(path), path, connect="tcp/a:1", http="127.0.0.1:1", data_dir=tmp_path)
    rendered = {name.replace("-", "_"): pod["containers"][0] for name, pod in pods(reports[name]).items()}
    expected = {spec.name: spec for spec in specs if "gateway" not in spec.name}
    assert set(rendered) == set(expected)
    for process, spec in expected.items():
        module = spec.argv[2]
        assert rendered[process]["command"][:3] == ["python", "-m", module]
        assert rendered[process]["image"] == f"{IMAGES[module]}:latest"
        if module == "services.dfpc_host":
            assert rendered[process]["command"][3:] == list(spec.argv[3:])
        if module != "services.dpm":
            tokens = rendered[process]["readinessProbe"]["exec"]["command"][3:]
            assert tokens == [f"{scope}/{service}" for scope, service in spec.tokens]


def test_each_container_has_probes_limits_and_no_rights(reports: dict[str, dict[str, Any]]) -> None:
    for name, pod in pods(reports["server"]).items():
        container = pod["containers"][0]
        assert {"startupProbe", "readinessProbe", "livenessProbe"} <= set(container), name
        assert "memory" in container["resources"]["limits"], name
        assert {"cpu", "memory"} <= set(container["resources"]["requests"]), name
        assert container["securityContext"]["allowPrivilegeEscalation"] is False
        assert container["securityContext"]["capabilities"] == {"drop": ["ALL"]}
        assert pod["automountServiceAccountToken"] is False
        assert pod["securityContext"]["runAsNonRoot"] is True
    limits = {
        n: p["containers"][0]["resources"]["limits"]["memory"] for n, p in pods(reports["server"]).items()
    }
    assert (limits["mana-mapping"], limits["minnie-mapping"]) == ("4Gi", "2500Mi")


def test_a_liveness_check_does_not_fail_with_the_router(reports: dict[str, dict[str, Any]]) -> None:
    for name, pod in pods(reports["server"]).items():
        probe = pod["containers"][0]["livenessProbe"]
        if name != "router" and not name.startswith("dpm"):
            assert "--without-router" in probe["exec"]["command"], name
    assert (
        "--without-router"
        not in pods(reports["server"])["router"]["containers"][0]["livenessProbe"]["exec"]["command"]
    )


def test_a_pod_has_the_identity_of_its_scope_and_connects_by_tls(reports: dict[str, dict[str, Any]]) -> None:
    for name, pod in pods(reports["rover_traverse"]).items():
        secret = next(v["secret"]["secretName"] for v in pod["volumes"] if v["name"] == "identity")
        scope = name.split("-")[0] if name.startswith(("mana", "minnie")) else "ground"
        assert secret == f"cdff-identity-{scope}"
        environment = {v["name"]: v.get("value") for v in pod["containers"][0]["env"]}
        assert environment["CDFF_CONNECT"] == "tls/mission-router:7447"
        assert environment["CDFF_IDENTITY"] == "/run/identity"
    opened = {v["name"]: v.get("value") for v in pods(reports["open"])["dpm"]["containers"][0]["env"]}
    assert opened["CDFF_CONNECT"] == "tcp/mission-router:7447"
    assert (opened["CDFF_HTTP_KEYS"], "CDFF_IDENTITY" in opened) == ("/run/keys/keys", False)


def test_workers_are_numbered_from_one_and_share_the_service_of_the_dpm(
    reports: dict[str, dict[str, Any]],
) -> None:
    workers = objects(reports["server"], "StatefulSet")["mission-dpm-worker"]["spec"]
    assert (workers["replicas"], workers["ordinals"]) == (3, {"start": 1})
    container = workers["template"]["spec"]["containers"][0]
    assert container["command"][-2:] == ["--worker", "$(CDFF_WORKER)"]
    number = next(v for v in container["env"] if v["name"] == "CDFF_WORKER")
    assert number["valueFrom"]["fieldRef"]["fieldPath"] == "metadata.labels['apps.kubernetes.io/pod-index']"
    selector = objects(reports["server"], "Service")["mission-dpm"]["spec"]["selector"]
    dpm = objects(reports["server"], "StatefulSet")["mission-dpm"]["spec"]["template"]["metadata"]["labels"]
    for labels in (dpm, workers["template"]["metadata"]["labels"]):
        assert selector.items() <= labels.items()
    assert "mission-dpm-worker" not in objects(reports["rover_traverse"], "StatefulSet")


def test_the_network_policy_admits_only_the_router_and_http(reports: dict[str, dict[str, Any]]) -> None:
    policies = objects(reports["server"], "NetworkPolicy")
    default = policies["mission-default"]["spec"]
    assert default["podSelector"] == {"matchLabels": {"app.kubernetes.io/instance": "mission"}}
    assert "ingress" not in default
    name_service, release = default["egress"]
    assert ({port["port"] for port in name_service["ports"]}, "to" in name_service) == ({53}, False)
    of_release = {"podSelector": default["podSelector"]}
    assert (release["to"], [port["port"] for port in release["ports"]]) == ([of_release], [7447, 8080])
    assert set(default["policyTypes"]) == {"Ingress", "Egress"}
    router, dpm = policies["mission-router"]["spec"], policies["mission-dpm"]["spec"]
    assert [port["port"] for port in router["ingress"][0]["ports"]] == [7447]
    assert router["ingress"][0]["from"] == [of_release, {"ipBlock": {"cidr": "192.0.2.0/24"}}]
    assert [port["port"] for port in dpm["ingress"][0]["ports"]] == [8080]
    assert dpm["egress"][0]["ports"] == [{"port": 5432}]


def test_disruption_budgets_protect_workers_and_single_services(reports: dict[str, dict[str, Any]]) -> None:
    budgets = {
        n: o["spec"]["maxUnavailable"] for n, o in objects(reports["server"], "PodDisruptionBudget").items()
    }
    names = ("router", "dpm", "orchestrator")
    assert budgets == {"mission-dpm-worker": 1} | {f"mission-{name}": 0 for name in names}
    assert objects(reports["rover_traverse"], "PodDisruptionBudget") == {}


def test_scopes_select_the_services_of_the_cluster(reports: dict[str, dict[str, Any]]) -> None:
    assert set(pods(reports["ground"])) == {"router", "dpm", "orchestrator", "icu"}


def test_the_profile_is_the_file_that_was_given(reports: dict[str, dict[str, Any]]) -> None:
    data = objects(reports["rover_traverse"], "ConfigMap")["mission-profile"]["data"]
    assert yaml.safe_load(data["profile.yaml"]) == yaml.safe_load(profile_text("rover_traverse"))
    assert "rover_mast.urdf" in data


@pytest.mark.parametrize(
    ("case", "reason"),
    [
        ("no profile", "give the mission profile with --set-file profile=FILE"),
        ("no YAML", "profile is no YAML mapping"),
        ("unknown scope", "scopes: nano; the profile has ground, mana, minnie"),
        ("unprotected", "dpm.httpKeysSecret is empty"),
        ("workers of an embedded store", "workers need dpm.store.url"),
        ("unknown value", "additional properties 'replicas' not allowed"),
        ("wrong type", "got string, want integer"),
        ("wrong quantity", "'20 GB' does not match pattern"),
    ],
)
def test_wrong_values_are_refused_with_a_reason(
    reports: dict[str, dict[str, Any]], case: str, reason: str
) -> None:
    assert reason in reports[case]["error"]
    assert reports[case]["objects"] == []
