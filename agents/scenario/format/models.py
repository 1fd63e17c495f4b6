"""Objects of a scenario file that have a model: their description fills in the fields that the file leaves out."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import msgspec

from agents.object_models import ObjectModel, find_model, load_model
from agents.scenario.format.inconsistency import InconsistencyError
from agents.scenario.format.model import ObjectSpec, Scenario
from dsr.config.toml_lines import Path
from dsr.errors import ConfigError

_SOLID = ("cube", "box")


def with_models(scenario: Scenario, data: dict[str, Any], folder: FilePath) -> Scenario:
    """The scenario with the models of its objects filled in.

    Args:
        scenario: as written.
        data: the file it was read from, as plain values, which tells what was left out.
        folder: that of the file, for paths of models.

    Raises:
        InconsistencyError: for a model that cannot be used, and for a shape without a model.
    """
    tables = data.get("object", [])
    objects = [
        _complete(spec, table, ("object", index), folder)
        for index, (spec, table) in enumerate(zip(scenario.objects, tables, strict=True))
    ]
    return msgspec.structs.replace(scenario, objects=objects)


def _complete(spec: ObjectSpec, table: dict[str, Any], path: Path, folder: FilePath) -> ObjectSpec:
    if "shape" in table:
        raise InconsistencyError((*path, "shape"), "unknown field; a shape comes with a `model`")
    if spec.model is None:
        if spec.type not in _SOLID:
            message = f"a {spec.type} needs a `model` that tells its shape, e.g. model = {spec.type!r}"
            raise InconsistencyError((*path, "type"), message)
        return spec
    try:
        model = load_model(find_model(spec.model, folder))
    except ConfigError as error:
        raise InconsistencyError((*path, "model"), str(error)) from error
    if "size" in table and model.shape:
        message = "only a model of one upright box can have another size; expected no `size`, or a model of that size"
        raise InconsistencyError((*path, "size"), message)
    return msgspec.structs.replace(spec, **{field: value for field, value in _given(model) if field not in table})


def _given(model: ObjectModel) -> list[tuple[str, Any]]:
    return [(field, value) for field, value in model._asdict().items() if value is not None]
