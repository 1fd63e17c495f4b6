"""A model file for the real `HandLandmarker`, its weights made up: it finds always the same hand, in bright images."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import flatbuffers
import numpy as np
from mediapipe.tasks.metadata import metadata_schema_py_generated as meta
from mediapipe.tasks.metadata import schema_py_generated as tfl

_BRIGHT = 0.3
"""Mean of the image (0 black, 1 white), above which there is a hand."""
_STEEP = 200.0
"""Logit of the hand's score per brightness."""
_ANCHOR = 1152 + (6 * 12 + 6) * 6
"""Of 2016, one in the middle of the image."""


def write_model(file: Path, crop: np.ndarray, world: np.ndarray) -> Path:
    """Write a `hand_landmarker.task` that answers with landmarks (21, 3) in px of the crop (224 x 224) and m."""
    boxes, scores = np.zeros((2016, 18), np.float32), np.full((2016, 1), -100.0, np.float32)
    boxes[_ANCHOR, 2:4] = 60.0  # px of 192: width and height about the anchor
    boxes[_ANCHOR, 4:] = np.array([(0, 25), (-12, -20), (0, -20), (8, -18), (15, -15), (-22, 15), (-25, 5)]).ravel()
    slope = np.zeros_like(scores)
    slope[_ANCHOR], scores[_ANCHOR] = _STEEP, -_STEEP * _BRIGHT
    detector = _network(192, [(boxes, 0 * boxes), (scores, slope)])
    flat, one = crop.astype(np.float32).reshape(1, 63), np.ones((1, 1), np.float32)
    metres = world.astype(np.float32).reshape(1, 63)
    landmarks = _network(224, [(flat, 0 * flat), (0.9 * one, 0 * one), (0.98 * one, 0 * one), (metres, 0 * metres)])
    with zipfile.ZipFile(file, "w") as archive:  # stored: MediaPipe maps the entries
        archive.writestr("hand_detector.tflite", detector)
        archive.writestr("hand_landmarks_detector.tflite", landmarks)
    return file


class _Network:
    """A TensorFlow Lite model of float tensors, in the making."""

    def __init__(self) -> None:
        self.buffers = [tfl.BufferT()]
        self.tensors: list[Any] = []
        self.operators: list[Any] = []
        self.codes: list[int] = []

    def tensor(self, shape: tuple[int, ...], values: np.ndarray | None = None, name: str = "t") -> int:
        tensor = tfl.TensorT()
        tensor.shape, tensor.name = list(shape), f"{name}{len(self.tensors)}"
        is_index = values is not None and values.dtype == np.int32
        tensor.type = tfl.TensorType.INT32 if is_index else tfl.TensorType.FLOAT32
        tensor.buffer = 0
        if values is not None:
            buffer = tfl.BufferT()
            buffer.data = np.frombuffer(values.tobytes(), np.uint8)
            self.buffers.append(buffer)
            tensor.buffer = len(self.buffers) - 1
        self.tensors.append(tensor)
        return len(self.tensors) - 1

    def operator(self, code: int, kind: int, options: Any, inputs: list[int], shape: tuple[int, ...]) -> int:
        if code not in self.codes:
            self.codes.append(code)
        made = tfl.OperatorT()
        made.opcodeIndex, made.inputs, made.outputs = self.codes.index(code), inputs, [self.tensor(shape)]
        made.builtinOptionsType, made.builtinOptions = kind, options
        self.operators.append(made)
        return made.outputs[0]


def _network(side: int, outputs: list[tuple[np.ndarray, np.ndarray]]) -> bytes:
    """From an image (1, side, side, 3) to `bias + slope * mean of the image` for each of the outputs."""
    ops, options = tfl.BuiltinOperator, tfl.BuiltinOptions
    net = _Network()
    image = net.tensor((1, side, side, 3), name="image")
    axes = net.tensor((3,), np.array([1, 2, 3], np.int32))
    mean = net.operator(ops.MEAN, options.ReducerOptions, tfl.ReducerOptionsT(), [image, axes], (1,))
    results = []
    for bias, slope in outputs:
        shape = bias.shape if bias.shape[0] == 1 else (1, *bias.shape)
        scaled = net.operator(ops.MUL, options.MulOptions, tfl.MulOptionsT(), [mean, net.tensor(shape, slope)], shape)
        results.append(
            net.operator(ops.ADD, options.AddOptions, tfl.AddOptionsT(), [scaled, net.tensor(shape, bias)], shape)
        )
    graph = tfl.SubGraphT()
    graph.tensors, graph.operators, graph.inputs, graph.outputs = net.tensors, net.operators, [image], results
    graph.name = "made up"
    model = tfl.ModelT()
    model.version, model.subgraphs, model.buffers, model.operatorCodes = 3, [graph], net.buffers, []
    for code in net.codes:
        operator = tfl.OperatorCodeT()
        operator.builtinCode = operator.deprecatedBuiltinCode = code
        operator.version = 1
        model.operatorCodes.append(operator)
    buffer = tfl.BufferT()
    buffer.data = np.frombuffer(_metadata(len(outputs)), np.uint8)
    model.buffers.append(buffer)
    entry = tfl.MetadataT()
    entry.name, entry.buffer = "TFLITE_METADATA", len(model.buffers) - 1
    model.metadata = [entry]
    return _packed(model, b"TFL3")


def _metadata(outputs: int) -> bytes:
    """That images are scaled to 0 .. 1."""
    scaling = meta.NormalizationOptionsT()
    scaling.mean, scaling.std = [0.0], [255.0]
    step = meta.ProcessUnitT()
    step.optionsType, step.options = meta.ProcessUnitOptions.NormalizationOptions, scaling
    image = meta.TensorMetadataT()
    image.name, image.processUnits = "image", [step]
    image.content = meta.ContentT()
    image.content.contentPropertiesType = meta.ContentProperties.ImageProperties
    image.content.contentProperties = meta.ImagePropertiesT()
    image.content.contentProperties.colorSpace = meta.ColorSpaceType.RGB
    graph = meta.SubGraphMetadataT()
    graph.inputTensorMetadata = [image]
    graph.outputTensorMetadata = [meta.TensorMetadataT() for _ in range(outputs)]
    whole = meta.ModelMetadataT()
    whole.name, whole.subgraphMetadata = "made up", [graph]
    return _packed(whole, b"M001")


def _packed(table: Any, identifier: bytes) -> bytes:
    builder = flatbuffers.Builder(1024)
    builder.Finish(table.Pack(builder), identifier)
    return bytes(builder.Output())
