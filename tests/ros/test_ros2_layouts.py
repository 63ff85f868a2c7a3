"""The layouts show fields of a ROS 2 node, in panels of Foxglove's own schema."""

from __future__ import annotations

import dataclasses
import json
import types
import xml.etree.ElementTree as ET
from importlib import import_module
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import pytest
from foxglove import layouts
from paths import ROOT
from ros2_client import Client

FOLDER = ROOT / "ros" / "rtamt_ros"
FOXGLOVE = json.loads((FOLDER / "layouts/foxglove.json").read_text())
PLOTJUGGLER = ET.parse(FOLDER / "layouts/plotjuggler.xml").getroot()  # noqa: S314 - our own file
CONFIGS: dict[str, Any] = {
    "Plot": layouts.PlotConfig,
    "StateTransitions": layouts.StateTransitionsConfig,
    "DiagnosticSummary": layouts.DiagnosticsSummaryConfig,
}

pytest_plugins = ["ros2_client"]


@pytest.fixture
def published(domain: Client) -> dict[str, type]:
    """Return the topics of a running monitor of the requirement of the layouts, with messages."""
    domain.shared("layouts", spec_file=str(FOLDER / "config/follows.stl"))
    topics: dict[str, str] = {}

    def complete() -> bool:
        names = domain.middleware.node.get_topic_names_and_types()
        own = {name.removeprefix("/layouts"): kinds[0] for name, kinds in names}
        topics.update({name: kind for name, kind in own.items() if name.startswith("/rtamt/")})
        topics.update({name: kind for name, kind in own.items() if name == "/diagnostics"})
        return "/rtamt/follows/verdict" in topics and "/diagnostics" in topics

    domain.until(complete)
    messages = {}
    for topic, kind in topics.items():
        package, _, name = kind.split("/")
        messages[topic] = getattr(import_module(f"{package}.msg"), name)
    return messages


def is_number(message: type, field: str) -> bool:
    """Return whether a message has a field of this name that a viewer can plot."""
    kind: str = message.get_fields_and_field_types().get(field, "")  # type: ignore[attr-defined]
    return kind.startswith(("double", "float", "int", "uint"))


def test_foxglove_plots_numbers_that_a_node_publishes(published: dict[str, type]) -> None:
    paths = [path for config in FOXGLOVE["configById"].values() for path in config.get("paths", ())]
    assert len(paths) == 5
    for path in paths:
        topic, _, field = path["value"].partition(".")
        assert is_number(published[topic], field)
    (summary,) = (c for c in FOXGLOVE["configById"].values() if "topicToRender" in c)
    assert published[summary["topicToRender"]].__name__ == "DiagnosticArray"


def test_plotjuggler_plots_numbers_that_a_node_publishes(published: dict[str, type]) -> None:
    curves = [curve.attrib["name"] for curve in PLOTJUGGLER.iter("curve")]
    assert len(curves) == 5
    for curve in curves:
        topic, _, field = curve.rpartition("/")
        assert is_number(published[topic], field)


def keys_of(kind: Any) -> dict[str, str]:  # noqa: ANN401 - a class of the SDK
    """Return the JSON key of each field of a class of Foxglove's schema, and the field."""
    names = {field.name: field.name for field in dataclasses.fields(kind)}
    keys: dict[str, str] = kind(**names)._to_dict()
    return keys


def conforms(value: object, kind: Any) -> bool:  # noqa: ANN401 - a type
    """Return whether a JSON value has a type of Foxglove's schema."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return any(conforms(value, each) for each in arguments)
    if origin is Literal:
        return value in arguments
    if origin is list:
        return isinstance(value, list) and all(conforms(each, arguments[0]) for each in value)
    if dataclasses.is_dataclass(kind):
        keys, hints = keys_of(kind), get_type_hints(kind)
        return isinstance(value, dict) and all(
            key in keys and conforms(each, hints[keys[key]]) for key, each in value.items()
        )
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    return isinstance(value, kind)


@pytest.mark.parametrize("panel", FOXGLOVE["configById"])
def test_each_panel_fits_the_schema_of_foxglove(panel: str) -> None:
    config = {
        key: value
        for key, value in FOXGLOVE["configById"][panel].items()
        if key != "foxglovePanelTitle"  # of every panel, next to its own configuration
    }
    kind = CONFIGS[panel.partition("!")[0]]
    assert conforms(config, kind)
    assert not conforms({**config, "unknown": 1}, kind)
    for key in config:
        assert not conforms({**config, key: object()}, kind)
