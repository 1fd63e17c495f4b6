"""Objects of a scenario file that have a model or a shape, which fill in the fields that the file leaves out."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import msgspec

from agents.object_models import ObjectModel, find_model, load_model, size_and_shape
from agents.scenario.format.inconsistency import InconsistencyError
from agents.scenario.format.model import ObjectSpec, Scenario
from dsr.config.toml_lines import Path
from dsr.errors import ConfigError
from dsr.math3d.quaternions import normalised

_SOLID = ("cube", "box")
_UNIT = 1e-3
"""By which the norm of a rotation that people write may be off."""


def with_models(scenario: Scenario, data: dict[str, Any], folder: FilePath) -> Scenario:
    """The scenario with the models of its objects filled in.

    Args:
        scenario: as written.
        data: the file it was read from, as plain values, which tells what was left out.
        folder: that of the file, for paths of models.

    Raises:
        InconsistencyError: for a model or a shape that cannot be used.
    """
    tables = data.get("object", [])
    objects = [
        _complete(spec, table, ("object", index), folder)
        for index, (spec, table) in enumerate(zip(scenario.objects, tables, strict=True))
    ]
    return msgspec.structs.replace(scenario, objects=objects)


def _complete(spec: ObjectSpec, table: dict[str, Any], path: Path, folder: FilePath) -> ObjectSpec:
    if "shape" in table:
        return _shaped(spec, table, path)
    if spec.model is None:
        if spec.type not in _SOLID:
            message = f"a {spec.type} needs a `model` that tells its shape, e.g. model = {spec.type!r}, or a `shape`"
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


def _shaped(spec: ObjectSpec, table: dict[str, Any], path: Path) -> ObjectSpec:
    """The object made of the parts that the file gives."""
    where = (*path, "shape")
    for field in ("model", "size"):
        if field in table:
            raise InconsistencyError(where, f"expected no `shape` where there is a `{field}`: each gives the extents")
    if any(part.corners for part in spec.shape):
        raise InconsistencyError(where, "a part with corners; expected kind, size, position and rotation")
    if spec.type == "ball" and [part.kind for part in spec.shape] != ["sphere"]:
        raise InconsistencyError(where, "a ball is one sphere; expected that, or another type")
    try:
        parts = [part._replace(rotation=normalised(part.rotation, _UNIT)) for part in spec.shape]
        size, shape = size_and_shape(tuple(parts))
    except ValueError as error:
        raise InconsistencyError(where, str(error)) from error
    return msgspec.structs.replace(spec, size=size, shape=shape)


def _given(model: ObjectModel) -> list[tuple[str, Any]]:
    return [(field, value) for field, value in model._asdict().items() if value is not None]
