# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scenario files: shipped ones by name, others by path, with ``extends`` and ``variants``."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import yaml

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import validated
from cdff_common.resources import deploy_folder, resolve

if TYPE_CHECKING:
    from cdff_dev.simulate.orbit.scenario import OrbitScenario
    from cdff_dev.simulate.scenario import Scenario

#: Folder of the shipped scenarios.
SCENARIO_FOLDER = deploy_folder() / "simulation"


def load_any_scenario(name: str, seed: int | None = None) -> Scenario | OrbitScenario:
    """Read a scenario on terrain or in orbit by name or path; ``seed`` replaces the seed of the file.

    Raises
    ------
    ConfigurationError
        If there is no such scenario, or a key or value in it is wrong.
    """
    from cdff_dev.simulate.orbit.scenario import OrbitScenario
    from cdff_dev.simulate.scenario import Scenario

    data = read_scenario(name)
    if seed is not None:
        data["seed"] = seed
    kind = data.get("kind", "terrain")
    if kind == "orbit":
        return validated(OrbitScenario, data, name)
    if kind != "terrain":
        raise ConfigurationError(
            f"{name}: kind={kind!r}: expected orbit, or no kind for a scenario on terrain"
        )
    return validated(Scenario, data, name)


def read_scenario(name: str) -> dict[str, Any]:
    """Return the content of a scenario file.

    A file with ``extends: NAME`` contains only the differences from the shipped scenario NAME; its robots
    replace those of that scenario. A shipped file with ``variants``, groups of named differences, is one
    scenario ``FILE_OPTION_OPTION_...`` for each combination of one option of each group.

    Raises
    ------
    ConfigurationError
        If there is no such scenario, or it is not a mapping.
    """
    of_variant = _variant_files().get(name)
    path = resolve("simulation", of_variant[0] if of_variant else name)
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: {error}") from error
    if not isinstance(data, dict):
        raise ConfigurationError(f"{path}: expected a mapping, got {type(data).__name__}")
    variants = data.pop("variants", None)
    if of_variant:
        for group, option in zip(variants.values(), of_variant[1], strict=True):
            data = _merge(data, group[option] or {})
        data["name"] = name
    elif variants is not None:
        names = [variant for variant, (file, _) in _variant_files().items() if file == path.stem]
        raise ConfigurationError(f"{name}: has variants: expected one of {', '.join(names)}")
    base_name = data.pop("extends", None)
    if base_name is None:
        return dict(data)
    if not isinstance(base_name, str) or base_name == path.stem:
        raise ConfigurationError(f"{path}: extends: {base_name!r}: expected the name of another scenario")
    base = read_scenario(base_name)
    if "robots" in data:
        base.pop("robots", None)
    return _merge(base, data)


def scenario_names() -> list[str]:
    """Return the names of all shipped scenarios, with those of variants."""
    variants = _variant_files()
    files = {path.stem for path in SCENARIO_FOLDER.glob("*.yaml")}
    return sorted((files - {file for file, _ in variants.values()}) | set(variants))


def _variant_files() -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return the name of the file and the options of each shipped variant."""
    result: dict[str, tuple[str, tuple[str, ...]]] = {}
    for path in sorted(SCENARIO_FOLDER.glob("*.yaml")):
        text = path.read_text(encoding="utf-8")
        if "\nvariants:" in text:
            groups = yaml.safe_load(text)["variants"].values()
            for options in itertools.product(*groups):
                result["_".join((path.stem, *options))] = (path.stem, options)
    return result


def _merge(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return ``base`` with the values of ``changes``; nested mappings are merged recursively."""
    return base | {
        key: _merge(base[key], value)
        if isinstance(value, dict) and isinstance(base.get(key), dict)
        else value
        for key, value in changes.items()
    }
