"""Draws what bodies look like by OpenGL: colours, depths and bodies in one pass, without a window."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any

import moderngl
import msgspec
import numpy as np
from numpy.typing import NDArray

from agents.plant.looks import Drawable, Looks, Painted

Matrix = NDArray[np.float64]
"""(4, 4)"""

_VERTEX = """
#version 330
uniform mat4 clip_from_shape;
uniform mat3 world_from_shape;
in vec3 position;
in vec3 normal;
in vec2 place;
out vec3 direction;
out vec2 at;
void main() {
    gl_Position = clip_from_shape * vec4(position, 1.0);
    direction = world_from_shape * normal;
    at = place;
}
"""
_FRAGMENT = """
#version 330
uniform sampler2D picture;
uniform vec3 color;
uniform vec3 light;
uniform float ambient;
uniform float diffuse;
uniform int number;
in vec3 direction;
in vec2 at;
layout(location = 0) out vec4 shown;
layout(location = 1) out int body;
void main() {
    float strength = ambient + diffuse * max(0.0, dot(normalize(direction), light));
    shown = vec4(texture(picture, at).rgb * color * strength, 1.0);
    body = number;
}
"""
_LIBRARIES = {"backend": "egl", "libgl": "libGL.so.1", "libegl": "libEGL.so.1"}
"""By their names where nothing but what programs need is installed."""


class Light(msgspec.Struct, frozen=True):
    """How a scene is lit. Nothing throws a shadow."""

    towards: tuple[float, float, float]
    """World, from the scene to the light."""
    ambient: float
    """1, share of its colour that a surface shows everywhere."""
    diffuse: float
    """1, share that one adds which faces the light."""
    sky: tuple[float, float, float]
    """Red, green and blue where nothing is, 0 to 1."""


class _Shape(msgspec.Struct, frozen=True, eq=False):
    """A drawable in the memory of the graphics library."""

    drawable: Drawable
    array: moderngl.VertexArray
    parts: tuple[Any, ...]
    """All that has to be released."""


class _Images(msgspec.Struct, frozen=True, eq=False):
    """What is drawn into."""

    size: tuple[int, int]
    """Width and height, px."""
    color: moderngl.Texture
    bodies: moderngl.Texture
    depth: moderngl.Texture
    frame: moderngl.Framebuffer

    def release(self) -> None:
        for part in (self.frame, self.depth, self.bodies, self.color):
            part.release()


class OpenGl:
    """The graphics library, with a memory of its own for one physics client.

    Args:
        looks: what there is to draw; it may change between pictures.
        light: of all pictures.

    Raises `OSError` if this machine has no such library, or none that draws without a window.
    """

    def __init__(self, looks: Looks, light: Light) -> None:
        try:
            options: dict[str, Any] = dict(_LIBRARIES) if sys.platform == "linux" else {}
            self._context = moderngl.create_context(standalone=True, require=330, **options)
            with self._context as context:
                self._program = context.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
                context.enable(moderngl.DEPTH_TEST)
        except Exception as error:  # it raises plain `Exception`
            raise OSError(f"no OpenGL 3.3 without a window: {error}") from error
        with self._context:
            self._set("light", np.array(light.towards) / np.linalg.norm(light.towards))
            self._set("ambient", light.ambient)
            self._set("diffuse", light.diffuse)
        self._sky = light.sky
        self._looks = looks
        self._shapes: dict[int, tuple[tuple[Drawable, ...], list[_Shape]]] = {}
        self._images: _Images | None = None

    @property
    def bodies(self) -> Iterable[int]:
        """Those that there are to draw."""
        return self._looks.bodies

    def draw(
        self, clip_from_world: Matrix, places: dict[tuple[int, int], Matrix], size: tuple[int, int]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.int32]]:
        """Colours (h, w, 3), values of the depth buffer (h, w) from 0 (near) to 1, and numbers of bodies (h, w).

        Rows are those of the buffer: the first one is where y of `clip_from_world` is -1. Where nothing is, the number
        is -1. `places` are world_from_link by body and link, and `size` is width and height in px.
        """
        with self._context:
            images = self._images_of(size)
            self._follow_looks()
            images.frame.use()
            images.frame.clear(*self._sky, 1.0, depth=1.0)
            for body, (_, shapes) in self._shapes.items():
                self._set("number", body)
                for shape in shapes:
                    self._draw(shape, clip_from_world, places[body, shape.drawable.link])
            color = np.frombuffer(images.color.read(alignment=1), np.uint8).reshape(size[1], size[0], 3)
            depth = np.frombuffer(images.depth.read(), np.float32).reshape(size[1], size[0])
            bodies = np.frombuffer(images.bodies.read(), np.int32).reshape(size[1], size[0])
        return color, depth, np.where(depth < 1.0, bodies, np.int32(-1))

    def close(self) -> None:
        """Give all memory back."""
        with self._context:
            self._release(list(self._shapes))
            if self._images is not None:
                self._images.release()
                self._images = None
            self._program.release()
        self._context.release()

    def _draw(self, shape: _Shape, clip_from_world: Matrix, world_from_link: Matrix) -> None:
        drawable = shape.drawable
        world_from_shape = world_from_link @ drawable.pose.matrix @ np.diag([*drawable.scale, 1.0])
        self._set("clip_from_shape", (clip_from_world @ world_from_shape).T)
        self._set("world_from_shape", (world_from_link @ drawable.pose.matrix)[:3, :3].T)
        self._set("color", drawable.color)
        shape.parts[0].use()
        shape.array.render()

    def _set(self, name: str, value: Any) -> None:
        kind = np.int32 if name == "number" else np.float32
        self._program[name].write(np.asarray(value, kind).tobytes())

    def _images_of(self, size: tuple[int, int]) -> _Images:
        """To draw into; kept from picture to picture as long as these have one size."""
        if self._images is not None and self._images.size == size:
            return self._images
        if self._images is not None:
            self._images.release()
        color, bodies = self._context.texture(size, 3, alignment=1), self._context.texture(size, 1, dtype="i4")
        depth = self._context.depth_texture(size)
        frame = self._context.framebuffer([color, bodies], depth)
        self._images = _Images(size, color, bodies, depth, frame)
        return self._images

    def _follow_looks(self) -> None:
        """Take up the looks of new bodies, and release those of bodies that are no more."""
        told = self._looks.bodies
        self._release([body for body, (looks, _) in self._shapes.items() if told.get(body) is not looks])
        for body, looks in told.items():
            if body not in self._shapes:
                self._shapes[body] = looks, [self._shape(drawable) for drawable in looks]

    def _release(self, bodies: list[int]) -> None:
        for body in bodies:
            for shape in self._shapes.pop(body)[1]:
                for part in (shape.array, *shape.parts):
                    part.release()

    def _shape(self, drawable: Drawable) -> _Shape:
        picture = self._picture(drawable.painted)
        corners = self._context.buffer(np.ascontiguousarray(drawable.painted.corners, np.float32).tobytes())
        layout = [(corners, "3f 3f 2f", "position", "normal", "place")]
        return _Shape(drawable, self._context.vertex_array(self._program, layout), (picture, corners))

    def _picture(self, painted: Painted) -> moderngl.Texture:
        """A picture whose lowest row comes first, as OpenGL has it."""
        image = np.ascontiguousarray(painted.picture[::-1])
        is_plain = bool((image == image[0, 0]).all())
        if is_plain:
            image = image[:1, :1]
        picture = self._context.texture((image.shape[1], image.shape[0]), 3, image.tobytes(), alignment=1)
        if is_plain:
            picture.filter = moderngl.NEAREST, moderngl.NEAREST
        else:
            picture.build_mipmaps()
            picture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
        picture.repeat_x = picture.repeat_y = False
        return picture
