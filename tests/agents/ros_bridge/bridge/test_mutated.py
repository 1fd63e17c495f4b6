"""Messages that are nearly right, on every topic that the bridge hears: it works on, and right ones still count."""

from __future__ import annotations

import random
import struct
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from agents.ros_bridge.link.link import Qos
from agents.ros_bridge.mapping.cameras import CAMERA_INFO, to_camera_info
from agents.ros_bridge.mapping.clouds import CLOUD, to_cloud
from agents.ros_bridge.mapping.detections import DETECTIONS, Believed, to_detections
from agents.ros_bridge.mapping.images import COMPRESSED, IMAGE, to_compressed, to_image
from agents.ros_bridge.mapping.joints import JOINT_STATE, to_joint_state
from agents.ros_bridge.mapping.markers import MARKERS
from agents.ros_bridge.mapping.stamps import CLOCK, to_clock
from agents.ros_bridge.mapping.transforms import to_stamped
from agents.ros_bridge.messages.transforms import TF_MESSAGE, encode_transforms
from dsr import Pose
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics
from tests.agents.ros_bridge.robot import LATCHED, TYPES, bridged

TICKS = 150
CONFIG = {
    "receive": {
        "cameras": {
            "plain": {"color": "/a/color", "depth": "/a/depth"},
            "packed": {"color": "/b/compressed", "depth": "/b/compressedDepth"},
        },
        "clouds": {"lidar": "/points"},
        "detections": {"/found": {}},
    }
}
COLOR = np.random.default_rng(0).integers(0, 256, (6, 8, 3), dtype=np.uint8)
DEPTH = COLOR[:, :, 0].astype(np.uint16)
POSE = Pose((1.0, 2.0, 3.0), covariance=np.eye(6) * 1e-3)
INTRINSICS = Intrinsics(500.0, 500.0, 4.0, 3.0, 8, 6)
WORDS = [
    bytes(4), b"\1\0\0\0", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", struct.pack("<f", float("inf")),
    *(struct.pack("<d", number) for number in (float("nan"), 1e308, -1e9, 0.0)),
]  # fmt: skip
"""What numbers and lengths are put in place of others"""


def right(now: float, frames: int) -> Iterator[tuple[str, str, bytes]]:
    """One message of each topic: name, type, CDR."""
    jpeg, png = (
        np.frombuffer(cv2.imencode(end, array)[1].tobytes(), np.uint8)
        for end, array in ((".jpg", COLOR), (".png", DEPTH))
    )
    yield "/tf", TF_MESSAGE, encode_transforms([to_stamped("world", f"f{i}", now, POSE) for i in range(frames)])
    yield "/tf_static", TF_MESSAGE, encode_transforms([to_stamped("f0", "fixed", 0.0, POSE)])
    seen = [Believed("cup_1", "cup", POSE, (0.1, 0.1, 0.1), 0.9), Believed("cup_2", "cup", POSE, None, 0.9)]
    depth = to_compressed(TYPES, now, "b_eye", np.concatenate([np.zeros(12, np.uint8), png]), "png")
    depth.format = "32FC1; compressedDepth" if frames > 1 else "16UC1; compressedDepth png"
    info = to_camera_info(TYPES, now, "a_eye", replace(INTRINSICS, distortion=Distortion("plumb_bob", (0.1,) * 5)))
    for name, type, message in (
        ("/joint_states", JOINT_STATE, to_joint_state(TYPES, now, ["a", "b"], [1.0, 2.0], [1.0, 2.0])),
        ("/a/color", IMAGE, to_image(TYPES, now, "a_eye", COLOR)),
        ("/a/depth", IMAGE, to_image(TYPES, now, "a_eye", DEPTH)),
        ("/a/camera_info", CAMERA_INFO, info),
        ("/b/compressed", COMPRESSED, to_compressed(TYPES, now, "b_eye", jpeg, "jpeg")),
        ("/b/compressedDepth", COMPRESSED, depth),
        ("/points", CLOUD, to_cloud(TYPES, now, "lidar_link", np.ones((5, 3), np.float32), COLOR.reshape(-1, 3)[:5])),
        ("/found", DETECTIONS, to_detections(TYPES, now, "a_eye", seen)),
        ("/clock", CLOCK, to_clock(TYPES, now - 1000.0)),
    ):
        yield name, type, TYPES.encode(type, message)


def mutated(cdr: bytes, chance: random.Random) -> bytes:
    """Some numbers or bytes replaced, the end cut off, or the byte order another one."""
    data = bytearray(cdr)
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        place, kind = chance.randrange(4, max(5, len(data))), chance.random()
        if kind < 0.6:
            word = chance.choice(WORDS)
            place = 4 + (place - 4) // len(word) * len(word)
            data[place : place + len(word)] = word
        elif kind < 0.85:
            data[place : place + 1] = bytes([chance.randrange(256)])
        elif kind < 0.9:
            del data[place:]
        else:
            data[1] = chance.choice((0, 1, 2))
    return bytes(data)


@pytest.mark.parametrize("clock", ["auto", "follow"])
def test_the_bridge_works_on(clock: str) -> None:
    chance = random.Random(7)
    with bridged({**CONFIG, "clock": clock}) as system:
        for type, name in ((DETECTIONS, "/dsr/beliefs"), (MARKERS, "/dsr/markers")):
            system.robot.listen(name, type)
        frames = system.memory.frames("plain")
        for tick in range(TICKS + 50):
            for name, type, cdr in right(system.now, chance.choice((1, 10))):
                qos = LATCHED if name == "/tf_static" else Qos(depth=100)
                is_right = tick >= TICKS or chance.random() < 0.1
                system.robot.publisher(name, type, qos).send(cdr if is_right else mutated(cdr, chance))
            system.run(0.02)
        assert system.lockstep.runner("ros_bridge").status().errors == 0
        assert system.counts["malformed"] > TICKS
        frame = frames.latest()
        assert frame is not None and {"color", "depth"} <= frame.arrays.keys()
        assert system.memory.transform("world", "f0").distance(POSE) == pytest.approx((0.0, 0.0))
        assert system.memory.transform("plain", "cup_1").distance(POSE)[0] < 1e-9
