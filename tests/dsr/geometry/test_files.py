"""Models from files: hierarchy, names and units are kept, matrices become poses, wrong files are told."""

from __future__ import annotations

import json
import math
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from dsr import ConfigError, MeshError, Pose
from dsr.geometry import Bounds, Model, load_model
from dsr.geometry import files as files_module
from dsr.geometry.model import Geometry, RawNode, to_model
from tests.dsr.geometry.shapes import CORNERS, FACES, block

OBJ = """
o seat
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
f 1 2 3 4
o back
v 0 0 2
v 1 0 2
v 0 0 3
f 5 6 7
"""
DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><created>2020-01-01T00:00:00Z</created><modified>2020-01-01T00:00:00Z</modified>
    {unit}<up_axis>{up}</up_axis></asset>
  <library_geometries><geometry id="tri" name="tri"><mesh>
    <source id="p"><float_array id="a" count="9">0 0 0 100 0 0 0 100 0</float_array><technique_common>
      <accessor source="#a" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
      <param name="Z" type="float"/></accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s">
    <node id="n1" name="Car"><translate>100 0 0</translate>
      <node id="n2" name="Front axle"><translate>0 200 0</translate><rotate>0 0 1 90</rotate>
        <node id="n3" name="wheel"><instance_geometry url="#tri"/></node>
        <node id="n4" name="wheel"><translate>0 0 50</translate><instance_geometry url="#tri"/></node>
      </node>
    </node>
  </visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"""


def write(folder: Path, name: str, content: str | bytes) -> Path:
    file = folder / name
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return file


def dae(up: str = "Z_UP", unit: str = '<unit name="cm" meter="0.01"/>') -> str:
    return DAE.replace("{up}", up).replace("{unit}", unit)


def glb(change: Any = None) -> bytes:
    """A body with two wheels of one geometry."""
    scene = trimesh.Scene()
    solid = trimesh.Trimesh(np.array(CORNERS), np.array(FACES), process=False)
    move = trimesh.transformations.translation_matrix
    scene.add_geometry(solid, node_name="body", geom_name="solid", transform=move((1, 0, 0)))
    for side, name in ((-1, "left"), (1, "right")):
        scene.graph.update(frame_from="body", frame_to=name, matrix=move((0, 0, side)), geometry="solid")
    data = bytes(scene.export(file_type="glb"))
    if change is None:
        return data
    length = struct.unpack_from("<I", data, 12)[0]
    header = json.loads(data[20 : 20 + length])
    change(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest


def root_from(model: Model) -> dict[str, Pose]:
    found: dict[str, Pose] = {}
    for node in model.nodes:
        found[node.name] = node.pose if node.parent is None else found[node.parent] @ node.pose
    return found


def points_of(model: Model, name: str) -> list[list[float]]:
    """All vertices of a node in the frame of the file."""
    node = next(node for node in model.nodes if node.name == name)
    matrix = root_from(model)[name].matrix
    points = np.concatenate([mesh.vertices for mesh in node.meshes])
    return sorted((points @ matrix[:3, :3].T + matrix[:3, 3]).round(6).tolist())


def test_collada_keeps_hierarchy_names_and_unit(tmp_path: Path) -> None:
    model = load_model(write(tmp_path, "car.dae", dae()))
    assert [(node.name, node.parent) for node in model.nodes] == [
        ("Car", None), ("Front_axle", "Car"), ("wheel", "Front_axle"), ("wheel_2", "Front_axle"),
    ]  # fmt: skip
    assert model.root.pose.t == (1.0, 0.0, 0.0) and model.nodes[1].pose.t == pytest.approx((0.0, 2.0, 0.0))
    assert len(model.meshes) == 1  # of both wheels
    assert points_of(model, "wheel_2") == [[0.0, 2.0, 0.5], [1.0, 2.0, 0.5], [1.0, 3.0, 0.5]]


@pytest.mark.parametrize(
    ("up", "place"), [("Z_UP", (1, 3, 0.5)), ("Y_UP", (1, -0.5, 3)), ("X_UP", (-3, -0.5, 1))]
)  # fmt: skip
def test_collada_says_which_axis_points_up(tmp_path: Path, up: str, place: tuple[float, ...]) -> None:
    model = load_model(write(tmp_path, "car.dae", dae(up)))
    assert [pytest.approx(point) for point in points_of(model, "wheel_2")].count(list(place)) == 1
    assert load_model(tmp_path / "car.dae", up="z").root.pose.t == (1.0, 0.0, 0.0)


def test_collada_without_a_unit_is_in_metres_and_scale_comes_on_top(tmp_path: Path) -> None:
    file = write(tmp_path, "car.dae", dae(unit=""))
    assert load_model(file).root.pose.t == (100.0, 0.0, 0.0)
    assert load_model(file, scale=0.001).root.pose.t == pytest.approx((0.1, 0.0, 0.0))


def test_glb_keeps_hierarchy_and_names_and_its_y_is_up(tmp_path: Path) -> None:
    model = load_model(write(tmp_path, "car.glb", glb()))
    assert {(node.name, node.parent) for node in model.nodes} == {
        ("body", None), ("left", "body"), ("right", "body")
    }  # fmt: skip
    assert [len(node.meshes) for node in model.nodes] == [1, 1, 1] and model.meshes == (block(),)
    low = np.min(points_of(model, "left"), axis=0)
    high = np.max(points_of(model, "left"), axis=0)
    assert low.tolist() == [1.0, 0.0, 0.0] and high.tolist() == [2.0, 1.0, 1.0]  # z of the file is -y here


def of_two_materials(header: Any) -> None:
    """Each mesh has one half of its triangles in each of two materials, and a line."""
    (primitive,) = header["meshes"][0]["primitives"]
    indices = header["accessors"][primitive["indices"]]
    half = indices["count"] // 2
    size = {5121: 1, 5123: 2, 5125: 4}[indices["componentType"]]
    first = len(header["accessors"])
    header["accessors"] += [dict(indices, count=half, byteOffset=half * size * part) for part in (0, 1)]
    halves = [dict(primitive, indices=first + part, material=part) for part in (0, 1)]
    header["meshes"][0]["primitives"] = [dict(primitive, mode=1), *halves]
    header["materials"] = [{"name": "red"}, {"name": "green"}]


def test_a_glb_of_several_materials_has_all_pieces_at_the_node(tmp_path: Path) -> None:
    model = load_model(write(tmp_path, "car.glb", glb(of_two_materials)))
    plain = load_model(write(tmp_path, "plain.glb", glb()))
    assert {(node.name, node.parent) for node in model.nodes} == {
        ("body", None), ("left", "body"), ("right", "body")
    }  # fmt: skip
    assert [[len(mesh.triangles) for mesh in node.meshes] for node in model.nodes] == [[6, 6]] * 3
    for name in ("body", "left", "right"):
        assert np.unique(points_of(model, name), axis=0).tolist() == points_of(plain, name)


def test_a_glb_keeps_what_is_below_lines_and_cameras(tmp_path: Path) -> None:
    def change(header: Any) -> None:
        solid = header["meshes"][0]["primitives"][0]
        header["meshes"].append({"primitives": [dict(solid, mode=1)]})
        header["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1, "aspectRatio": 1.0}}]
        (body,) = (node for node in header["nodes"] if node["name"] == "body")
        body.update(mesh=1, camera=0)

    model = load_model(write(tmp_path, "car.glb", glb(change)))
    assert {(node.name, node.parent, len(node.meshes)) for node in model.nodes} == {
        ("body", None, 0), ("left", "body", 1), ("right", "body", 1)
    }  # fmt: skip


def test_obj_has_its_objects_below_one_node_of_the_files_name(tmp_path: Path) -> None:
    model = load_model(write(tmp_path, "chair.OBJ", OBJ))
    assert {(node.name, node.parent) for node in model.nodes} == {
        ("chair", None), ("seat", "chair"), ("back", "chair")
    }  # fmt: skip
    assert model.root.meshes == () and model.root.bounds is None
    seat = next(node for node in model.nodes if node.name == "seat")
    assert len(seat.meshes[0].triangles) == 2 and seat.bounds == Bounds((0.0, 0.0, 0.0), (1.0, 1.0, 0.0))


@pytest.mark.parametrize("form", ["stl", "stl_ascii"])
def test_stl_is_one_node_with_each_vertex_once(tmp_path: Path, form: str) -> None:
    solid = trimesh.Trimesh(np.array(CORNERS), np.array(FACES), process=False)
    model = load_model(write(tmp_path, "block 1.stl", solid.export(file_type=form)), scale=0.001)
    (node,) = model.nodes
    assert node.name == "block_1" and node.meshes == (block(0.001, 0.001, 0.001),)


def test_the_same_file_gives_the_same_meshes_everywhere(tmp_path: Path) -> None:
    once, again = (load_model(write(tmp_path, f"{name}.glb", glb())) for name in "ab")
    assert [mesh.hash for mesh in once.meshes] == [mesh.hash for mesh in again.meshes]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.obj", b"", "is empty"),
        ("a.obj", b"v 0 0 0\n", "."),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 9\n", "."),
        ("a.obj", b"v 0 0 zero\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "no valid OBJ"),
        ("a.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite"),
        ("a.obj", b"v 0 0 1e99\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
        ("a.obj", b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "."),
        ("a.obj", b"v 0 0 0\0", "is no text"),
        ("a.stl", b"solid x\n" + b" " * 90 + b"\0", "is no text"),
        ("a.obj", b"v 0 0 1e30\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "is the scale right"),
        ("a.stl", b"nonsense", "no valid STL: 8 bytes, neither text nor"),
        ("a.stl", bytes(range(256)) * 20, "no valid STL: 5120 bytes, neither text nor"),
        ("a.stl", b"x" * 80 + struct.pack("<I", 1 << 31) + bytes(50), "no valid STL"),
        ("a.stl", b"x" * 80 + struct.pack("<I", 0), "."),
        ("a.glb", b"glTF", "4 bytes"),
        ("a.glb", b"PK\x03\x04" + bytes(100), "begins with b'PK"),
        ("a.glb", glb()[:200], "cut off"),
        ("a.glb", glb(lambda h: h["accessors"][0].update(count=1 << 40)), "elements; at most"),
        ("a.glb", glb(lambda h: h["accessors"][0].update(count=100)), "no valid GLB"),
        ("a.glb", glb(lambda h: h["buffers"][0].update(uri="/etc/passwd")), "refers to other files"),
        ("a.glb", glb(lambda h: h.update(buffers="x")), "no valid GLB"),
        ("a.glb", glb(lambda h: h.update(meshes=[])), "."),
        ("a.glb", glb(lambda h: h["meshes"][0]["primitives"][0].update(mode=1)), "no triangles"),
        ("a.glb", glb(lambda h: h["bufferViews"][0].update(byteOffset=-8)), "no valid GLB: .*byteOffset"),
        ("a.dae", b"<COLLADA>", "no valid DAE"),
        ("a.dae", b"<!DOCTYPE x [<!ENTITY a 'b'>]>" + dae().encode(), "without DOCTYPE"),
        ("a.dae", dae().encode("utf-16"), "no text"),
        ("a.dae", dae().replace('meter="0.01"', 'meter="0"').encode(), r"unit of 0\.0 m"),
        ("a.dae", b"PK\x03\x04\0\0", "no text"),
        ("a.dae", dae().replace("#tri", "#other").encode(), "no triangles"),
        ("a.dae", dae().replace("0 1 2</p>", "0 1 7</p>").encode(), "."),
        ("a.gltf", b"{}", "end in .obj, .stl, .glb, .dae"),
        ("a", b"{}", "end in"),
    ],
)
def test_wrong_files_are_told(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as error:
        load_model(write(tmp_path, name, content))
    assert str(tmp_path / name) in str(error.value) and len(str(error.value)) < 500


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("latin.obj", ("# créé\n" + TRIANGLE).encode("latin-1")),
        ("latin.stl", ("solid pièce\n" + FACET).encode("latin-1")),
        ("bom.obj", b"\xef\xbb\xbf" + TRIANGLE.encode()),
        ("bom.stl", b"\xef\xbb\xbfsolid x\n" + FACET.encode()),
        ("behind.stl", bytes(80) + struct.pack("<I12f", 1, *[0.0] * 6, 1.0, *[0.0] * 3, 1.0, 0.0) + bytes(2) + b"more"),
    ],
)
def test_any_usual_text_is_read_and_what_is_behind_a_binary_stl_is_not(
    tmp_path: Path, name: str, content: bytes
) -> None:
    (node,) = load_model(write(tmp_path, name, content)).nodes
    assert sorted(node.meshes[0].vertices.tolist()) == [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]


def draco(header: Any, required: bool) -> None:
    name = "KHR_draco_mesh_compression"
    header["extensionsUsed"] = [name]
    if required:
        header["extensionsRequired"] = [name]
    for primitive in header["meshes"][0]["primitives"]:
        primitive["extensions"] = {name: {"bufferView": 0, "attributes": {"POSITION": 0}}}


def without_data(header: Any) -> None:
    for accessor in header["accessors"]:
        del accessor["bufferView"]


def test_a_glb_that_is_compressed_or_sparse_is_refused(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    def position(header: Any) -> Any:
        return header["accessors"][header["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]

    cases = {
        "compressed by Draco": lambda header: draco(header, required=True),
        "by Draco": lambda header: (draco(header, required=False), without_data(header)),
        "without data": without_data,
        "sparse": lambda header: position(header).update(sparse={"count": 1}),
        "quantised": lambda header: position(header).update(normalized=True),
        "fans": lambda header: header["meshes"][0]["primitives"][0].update(mode=6),
    }
    for message, change in cases.items():
        with pytest.raises(ConfigError, match=message):
            load_model(write(tmp_path, "a.glb", glb(change)))
    assert not caplog.records and not capfd.readouterr().err


def test_a_glb_that_is_compressed_beside_plain_data_is_read(tmp_path: Path) -> None:
    plain, both = glb(), glb(lambda header: draco(header, required=False))
    assert load_model(write(tmp_path, "a.glb", both)) == load_model(write(tmp_path, "a.glb", plain))


@pytest.mark.parametrize(
    ("name", "part", "message"),
    [
        ("a.obj", "usemtl m\nf 1 2 3\n", "parts"),
        ("a.obj", "use\\\nmtl m\nf 1 2 3\n", "parts"),
        ("a.obj", "use\\\r\nmtl m\r\nf 1 2 3\r\n", "parts"),
        ("a.obj", "s usemtl m\nf 1 2 3\n", "parts"),
        ("a.obj", "f 1\\\n", "characters"),
        ("a.stl", "solid a\n" + FACET + "endsolid a\n", "parts"),
        ("a.stl", FACET + "endsolid a solid a\n", "parts"),
    ],
)
def test_too_many_parts_are_refused_wherever_in_a_line_they_begin(
    tmp_path: Path, name: str, part: str, message: str
) -> None:
    """Lines that go on, and a `solid` within a line, passed the limits before."""
    begin = "solid a\n" if name.endswith("stl") else TRIANGLE
    with pytest.raises(ConfigError, match=f"more than .* {message}"):
        load_model(write(tmp_path, name, begin + 10_000 * part))


@pytest.mark.timeout(20)
def test_devices_and_pipes_are_told(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.obj")
    (tmp_path / "zero.stl").symlink_to("/dev/zero")
    for name in ("pipe.obj", "zero.stl"):
        with pytest.raises(ConfigError, match="cannot be read: it is a device or a pipe"):
            load_model(tmp_path / name)


def test_missing_and_huge_files_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match=r"cannot be read: No such file"):
        load_model(tmp_path / "none.obj")
    (tmp_path / "folder.obj").mkdir()
    with pytest.raises(ConfigError, match="cannot be read"):
        load_model(tmp_path / "folder.obj")
    monkeypatch.setattr(files_module, "MOST_FILE_BYTES", 10)
    with pytest.raises(ConfigError, match="at most"):
        load_model(write(tmp_path, "huge.obj", OBJ))
    with pytest.raises(ConfigError, match="scale"):
        load_model(tmp_path / "huge.obj", scale=0.0)


def test_a_collada_that_uses_itself_again_and_again_is_refused(tmp_path: Path) -> None:
    levels = "".join(
        f'<node id="l{k}"><instance_node url="#l{k + 1}"/><instance_node url="#l{k + 1}"/></node>'
        for k in range(24, -1, -1)
    )
    levels = f'<node id="l25"><instance_geometry url="#tri"/></node>{levels}'
    scenes = "<library_visual_scenes>"
    text = dae().replace(scenes, f"<library_nodes>{levels}</library_nodes>{scenes}")
    text = text.replace('<node id="n1"', '<node id="top"><instance_node url="#l0"/></node><node id="n1"')
    with pytest.raises(ConfigError, match=r"more than|levels|no valid"):
        load_model(write(tmp_path, "bomb.dae", text))


@settings(max_examples=60)
@given(st.data())
def test_damaged_files_never_do_worse_than_an_error(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    suffix, content = data.draw(st.sampled_from([(".glb", glb()), (".dae", dae().encode()), (".obj", OBJ.encode())]))
    damaged = bytearray(content)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    file = tmp_path_factory.mktemp("damaged") / f"m{suffix}"
    file.write_bytes(damaged[: data.draw(st.integers(1, len(damaged)))] if data.draw(st.booleans()) else damaged)
    try:
        model = load_model(file)
    except ConfigError:
        return
    assert model.meshes


numbers = st.floats(-2.0, 2.0)
matrices = st.lists(numbers, min_size=12, max_size=12).map(
    lambda values: np.vstack([np.array(values).reshape(3, 4), (0, 0, 0, 1)])
)


@given(matrices, matrices)
def test_points_stay_where_the_files_matrices_put_them(upper: Any, lower: Any) -> None:
    """Also where these scale, shear or mirror, which poses cannot."""
    for matrix in (upper, upper @ lower):
        if np.linalg.svd(matrix[:3, :3])[1][2] < 1e-3:
            return
    piece = Geometry(np.array(CORNERS), np.array(FACES))
    raw = RawNode("a", upper, [], [RawNode("b", lower, [piece])])
    model = to_model([raw], "file", np.eye(4))
    expected = np.array(CORNERS) @ (upper @ lower)[:3, :3].T + (upper @ lower)[:3, 3]
    found = np.array(points_of(model, "b"))
    for point in expected:
        assert np.abs(found - point).max(axis=1).min() < 1e-4
    triangle = model.meshes[0].vertices[model.meshes[0].triangles]
    volume = np.einsum("ni,ni->n", triangle[:, 0], np.cross(triangle[:, 1], triangle[:, 2])).sum() / 6.0
    assert volume == pytest.approx(
        abs(np.linalg.det((upper @ lower)[:3, :3])), rel=1e-2, abs=1e-4
    )  # outside is outside


def test_a_flat_matrix_is_refused() -> None:
    with pytest.raises(MeshError, match="flattens"):
        to_model([RawNode("a", np.diag([1.0, 1.0, 0.0, 1.0]))], "file", np.eye(4))


def test_merged_is_one_rigid_body_about_its_centre(tmp_path: Path) -> None:
    model = load_model(write(tmp_path, "car.glb", glb()), up="z")
    whole = model.merged()
    (node,) = whole.nodes
    assert node.name == "body" and len(node.meshes) == 3
    assert node.bounds == Bounds((-0.5, -0.5, -1.5), (0.5, 0.5, 1.5))
    assert node.pose.t == pytest.approx((1.5, 0.5, 0.5))
    assert model.merged((0.5, 0.5, 1.0)).root.bounds == Bounds((-0.5, -0.5, -3.0), (0.5, 0.5, 0.0))
    assert math.isclose(whole.root.pose.t[0], 1.5)
