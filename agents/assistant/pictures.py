"""The newest picture of a camera as JPEG, small enough for an assistant."""

from __future__ import annotations

import cv2

from agents.frame_images import images
from dsr.errors import ConfigError
from dsr.memory import Memory

WIDTH = 640
"""px, of the widest picture: assistants shrink larger ones"""
_QUALITY = 85  # of JPEG, in percent
_PATIENCE = 3.0  # s to wait for the next frame; cameras give several a second


def picture(memory: Memory, camera: str) -> bytes:
    """The next frame of a camera as JPEG, at most `WIDTH` px wide. Waits for it.

    Raises:
        ConfigError: if there is no such camera, or it sends no frame in time.
        WireError: for an unusable frame.
    """
    node = memory.get_node(camera)
    if node is None or node.type != "camera":
        cameras = sorted(node.name for node in memory.nodes("camera"))
        raise ConfigError(f"there is no camera {camera!r}; there are: {', '.join(cameras) or 'none'}")
    reader = memory.frames(node.get("stream") or camera)
    try:
        frame = reader.wait(_PATIENCE)
    finally:
        reader.close()
    if frame is None:
        raise ConfigError(f"camera {camera!r} sent no frame within {_PATIENCE:g} s")
    color = cv2.cvtColor(images(frame)[0], cv2.COLOR_RGB2BGR)
    if color.shape[1] > WIDTH:
        height = round(color.shape[0] * WIDTH / color.shape[1])
        color = cv2.resize(color, (WIDTH, height), interpolation=cv2.INTER_AREA)
    done, encoded = cv2.imencode(".jpg", color, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not done:
        raise ConfigError(f"the frame of camera {camera!r} cannot be encoded")
    return encoded.tobytes()
