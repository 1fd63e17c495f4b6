"""Draws what bodies look like by OpenGL: colours, depths and bodies in one pass, without a window."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any

import cv2
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
uniform vec3 light;
uniform float ambient;
uniform float diffuse;
in vec3 position;
in vec3 normal;
in vec2 place;
out float strength;
out vec2 at;
void main() {
    gl_Position = clip_from_shape * vec4(position, 1.0);
    strength = ambient + diffuse * max(0.0, dot(normalize(world_from_shape * normal), light));
    at = place;
}
"""
_FRAGMENT = """
#version 330
uniform sampler2D picture;
uniform vec3 color;
uniform int number;
in float strength;
in vec2 at;
layout(location = 0) out vec4 shown;
layout(location = 1) out float along_axis;
layout(location = 2) out int body;
void main() {
    shown = vec4(PAINT * color * strength, 1.0);
    along_axis = 1.0 / gl_FragCoord.w;
    body = number;
}
"""
_PAINTS = {"plain": "vec3(1.0)", "painted": "texture(picture, at).rgb"}
"""What a surface shows under a white light, by program: to look into a picture takes a third of the time of a pixel"""
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

    body: int
    link: int
    link_from_shape: Matrix
    """Scaled"""
    link_from_normals: Matrix
    """(3, 3)"""
    color: NDArray[np.float32]
    """(3,) by which the picture is multiplied, or that it has everywhere"""
    array: moderngl.VertexArray
    corners: moderngl.Buffer
    picture: moderngl.Texture | None
    """None for a surface of one colour"""

    def release(self) -> None:
        for part in (self.array, self.corners, self.picture):
            if part is not None:
                part.release()


class _Images:
    """Pictures that are drawn into.

    Args:
        context: of the graphics library.
        size: width and height, px.
    """

    def __init__(self, context: moderngl.Context, size: tuple[int, int]) -> None:
        self.size = size
        self.color, self.depth = context.texture(size, 4), context.texture(size, 1, dtype="f4")
        self.bodies = context.texture(size, 1, dtype="i4")
        self._nearest = context.depth_texture(size)
        self._sky = context.framebuffer([self.color])
        self._frames = {
            False: context.framebuffer([self.color, self.depth], self._nearest),
            True: context.framebuffer([self.color, self.depth, self.bodies], self._nearest),
        }

    def begin(self, sky: tuple[float, float, float], *, bodies: bool) -> None:
        """Show nothing but the sky, and draw into these pictures from now on, into that of bodies if asked for."""
        self._frames[bodies].clear()
        self._sky.clear(*sky, 1.0)
        self._frames[bodies].use()

    def release(self) -> None:
        parts: list[Any] = [*self._frames.values(), self._sky, self._nearest, self.bodies, self.depth, self.color]
        for part in parts:
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
                self._programs = {
                    name: context.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT.replace("PAINT", paint))
                    for name, paint in _PAINTS.items()
                }
                context.enable(moderngl.DEPTH_TEST)
        except Exception as error:  # it raises plain `Exception`
            raise OSError(f"no OpenGL 3.3 without a window: {error}") from error
        with self._context:
            for program in self._programs.values():
                program["light"].write(_bytes(np.array(light.towards) / np.linalg.norm(light.towards)))
                program["ambient"].write(_bytes(light.ambient))
                program["diffuse"].write(_bytes(light.diffuse))
        self._sky = light.sky
        self._looks = looks
        self._shapes: dict[int, tuple[tuple[Drawable, ...], list[_Shape]]] = {}
        self._images: _Images | None = None

    @property
    def bodies(self) -> Iterable[int]:
        """Those that there are to draw."""
        return self._looks.bodies

    def draw(
        self, clip_from_world: Matrix, places: dict[tuple[int, int], Matrix], size: tuple[int, int], *, bodies: bool
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.int32] | None]:
        """Colours (h, w, 3), depths (h, w) in m along the optical axis, and numbers of bodies (h, w) if `bodies`.

        Rows are those of the buffer: the first one is where y of `clip_from_world` is -1. Where nothing is, the depth
        is 0, and the number is -1. `places` are world_from_link by body and link, and `size` is width and height in px.
        """
        shape = size[1], size[0]
        with self._context:
            images = self._images_of(size)
            self._follow_looks()
            images.begin(self._sky, bodies=bodies)
            self._draw_shapes(clip_from_world, places, bodies=bodies)
            color = np.frombuffer(images.color.read(), np.uint8).reshape(*shape, 4)
            depth = np.frombuffer(images.depth.read(), np.float32).reshape(shape)
            numbers = np.frombuffer(images.bodies.read(), np.int32).reshape(shape) if bodies else None
        numbers = None if numbers is None else np.where(depth > 0.0, numbers, np.int32(-1))
        return np.asarray(cv2.cvtColor(color, cv2.COLOR_RGBA2RGB), np.uint8), depth, numbers

    def close(self) -> None:
        """Give all memory back."""
        with self._context:
            self._release(list(self._shapes))
            if self._images is not None:
                self._images.release()
                self._images = None
            for program in self._programs.values():
                program.release()
        self._context.release()

    def _draw_shapes(self, clip_from_world: Matrix, places: dict[tuple[int, int], Matrix], *, bodies: bool) -> None:
        """Draw all there is, the nearest first: what is behind that takes no time."""
        shapes = [shape for _, of_body in self._shapes.values() for shape in of_body]
        if not shapes:
            return
        links = np.array([places[shape.body, shape.link] for shape in shapes])
        in_clip = clip_from_world @ links @ np.array([shape.link_from_shape for shape in shapes])
        turns = links[:, :3, :3] @ np.array([shape.link_from_normals for shape in shapes])
        to_clip, to_world = (np.swapaxes(matrices, 1, 2).astype(np.float32, "C") for matrices in (in_clip, turns))
        for index in np.argsort(in_clip[:, 3, 3], kind="stable").tolist():
            shape = shapes[index]
            program = shape.array.program
            program["clip_from_shape"].write(to_clip[index])
            program["world_from_shape"].write(to_world[index])
            program["color"].write(shape.color)
            if bodies:
                program["number"].write(np.int32(shape.body))
            if shape.picture is not None:
                shape.picture.use()
            shape.array.render()

    def _images_of(self, size: tuple[int, int]) -> _Images:
        """To draw into; kept from picture to picture as long as these have one size."""
        if self._images is not None and self._images.size == size:
            return self._images
        if self._images is not None:
            self._images.release()
        self._images = _Images(self._context, size)
        return self._images

    def _follow_looks(self) -> None:
        """Take up the looks of new bodies, and release those of bodies that are no more."""
        told = self._looks.bodies
        self._release([body for body, (looks, _) in self._shapes.items() if told.get(body) is not looks])
        for body, looks in told.items():
            if body not in self._shapes:
                self._shapes[body] = looks, [self._shape(body, drawable) for drawable in looks]

    def _release(self, bodies: list[int]) -> None:
        for body in bodies:
            for shape in self._shapes.pop(body)[1]:
                shape.release()

    def _shape(self, body: int, drawable: Drawable) -> _Shape:
        painted, link_from_painted = drawable.painted, drawable.pose.matrix
        program, layout, inputs = "painted", "3f 3f 2f", ["position", "normal", "place"]
        color, picture = np.array(drawable.color, np.float32), None
        if (painted.picture == painted.picture[0, 0]).all():
            program, layout, inputs = "plain", "3f 3f 2x4", inputs[:2]
            color *= painted.picture[0, 0] / np.float32(255)
        else:
            picture = self._picture(painted)
        corners = self._context.buffer(np.ascontiguousarray(painted.corners, np.float32).tobytes())
        array = self._context.vertex_array(self._programs[program], [(corners, layout, *inputs)])
        scaled = link_from_painted @ np.diag([*drawable.scale, 1.0])
        return _Shape(body, drawable.link, scaled, link_from_painted[:3, :3], color, array, corners, picture)

    def _picture(self, painted: Painted) -> moderngl.Texture:
        """A picture whose lowest row comes first, as OpenGL has it."""
        image = np.ascontiguousarray(painted.picture[::-1])
        picture = self._context.texture((image.shape[1], image.shape[0]), 3, image.tobytes(), alignment=1)
        picture.build_mipmaps()
        picture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
        picture.repeat_x = picture.repeat_y = False
        return picture


def _bytes(value: Any) -> bytes:
    """Numbers as the graphics library takes them."""
    return np.asarray(value, np.float32).tobytes()
