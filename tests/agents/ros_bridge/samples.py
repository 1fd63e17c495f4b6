"""Messages of many types with values in every field, as our side makes them."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from agents.ros_bridge.messages.types import RosTypes, types_of

TYPES = types_of("jazzy")
WIDTH, HEIGHT = 640, 480


def plain(message: Any) -> Any:
    """The fields of a message as lists, which can be compared."""
    if is_dataclass(message):
        return [plain(getattr(message, field.name)) for field in fields(message) if not field.name.startswith("__")]
    if isinstance(message, np.ndarray):
        return message.tolist()
    return [plain(item) for item in message] if isinstance(message, list) else message


def header(types: RosTypes = TYPES, frame: str = "camera", sec: int = 1_700_000_000, nanosec: int = 123_456_789) -> Any:
    stamp = types.new("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return types.new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def transform(child: str, x: float, types: RosTypes = TYPES, parent: str = "world", sec: int = 1_700_000_000) -> Any:
    moved = types.new("geometry_msgs/msg/Vector3", x=x, y=-0.25, z=1e-3)
    turned = types.new("geometry_msgs/msg/Quaternion", x=0.0, y=0.6, z=0.0, w=0.8)
    return types.new(
        "geometry_msgs/msg/TransformStamped", header=header(types, parent, sec), child_frame_id=child,
        transform=types.new("geometry_msgs/msg/Transform", translation=moved, rotation=turned),
    )  # fmt: skip


def tf(*children: str, types: RosTypes = TYPES) -> Any:
    return types.new(
        "tf2_msgs/msg/TFMessage", transforms=[transform(name, k / 7, types) for k, name in enumerate(children)]
    )


def image(number: int = 0, types: RosTypes = TYPES) -> Any:
    data = np.arange(WIDTH * HEIGHT * 3, dtype=np.uint32).astype(np.uint8)
    data[:4] = np.frombuffer(number.to_bytes(4, "little"), np.uint8)
    return types.new(
        "sensor_msgs/msg/Image", header=header(types), height=HEIGHT, width=WIDTH, encoding="rgb8", step=WIDTH * 3,
        data=data,
    )  # fmt: skip


def joints(*positions: float, types: RosTypes = TYPES) -> Any:
    names = [f"joint_{number}" for number in range(len(positions))]
    return types.new(
        "sensor_msgs/msg/JointState", header=header(types, ""), name=names, position=positions,
        velocity=[2 * position for position in positions], effort=[],
    )  # fmt: skip


def samples(types: RosTypes = TYPES) -> dict[str, Any]:
    """One or more of each kind of field: strings, arrays, sequences, nested, empty and not."""
    new = types.new
    small = new(
        "sensor_msgs/msg/Image", header=header(types), height=1, width=3, encoding="mono8", step=3, data=[1, 2, 3]
    )
    field = new("sensor_msgs/msg/PointField", name="x", offset=0, datatype=7, count=1)
    cloud = new(
        "sensor_msgs/msg/PointCloud2", header=header(types), height=1, width=2, fields=[field], point_step=4,
        row_step=8, data=np.arange(8), is_dense=True,
    )  # fmt: skip
    info = new(
        "sensor_msgs/msg/CameraInfo", header=header(types), height=480, width=640, distortion_model="plumb_bob",
        d=[0.1, -0.2, 0.0, 0.0, 0.05], k=np.arange(9) / 2, r=np.eye(3).ravel(), p=np.arange(12) / 3,
    )  # fmt: skip
    point = new("geometry_msgs/msg/Point", x=1.0, y=2.0, z=3.0)
    pose = new("geometry_msgs/msg/Pose", position=point, orientation=new("geometry_msgs/msg/Quaternion", w=1.0))
    marker = new(
        "visualization_msgs/msg/Marker", header=header(types), ns="belief", id=7, type=1, pose=pose, points=[point] * 2,
        colors=[new("std_msgs/msg/ColorRGBA", r=1.0, a=0.5)], text="cup \N{GREEK SMALL LETTER MU}",
    )  # fmt: skip
    uncertain = new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=range(36))
    value = new("diagnostic_msgs/msg/KeyValue", key="rate", value="10")
    status = new("diagnostic_msgs/msg/DiagnosticStatus", level=1, name="viewer", message="slow", values=[value])
    moment = new("trajectory_msgs/msg/JointTrajectoryPoint", positions=[0.1], velocities=[0.2])
    diagnostics = new("diagnostic_msgs/msg/DiagnosticArray", header=header(types), status=[status])
    motion = new("trajectory_msgs/msg/JointTrajectory", joint_names=["a"], points=[moment])
    frames = ["x" * length for length in range(9)]
    return {
        "builtin_interfaces/msg/Time": new("builtin_interfaces/msg/Time", sec=-5, nanosec=7),
        "std_msgs/msg/Header": header(types),
        "std_msgs/msg/Empty": new("std_msgs/msg/Empty"),
        "std_msgs/msg/String": new("std_msgs/msg/String", data="h\u00e9llo"),
        "rosgraph_msgs/msg/Clock": new("rosgraph_msgs/msg/Clock", clock=new("builtin_interfaces/msg/Time", sec=9)),
        "geometry_msgs/msg/PoseWithCovariance": uncertain,
        "tf2_msgs/msg/TFMessage": tf(*frames, types=types),
        "sensor_msgs/msg/JointState": joints(0.1, -0.2, types=types),
        "sensor_msgs/msg/Image": small,
        "sensor_msgs/msg/CompressedImage": new("sensor_msgs/msg/CompressedImage", format="jpeg", data=[255, 216]),
        "sensor_msgs/msg/CameraInfo": info,
        "sensor_msgs/msg/PointCloud2": cloud,
        "visualization_msgs/msg/MarkerArray": new("visualization_msgs/msg/MarkerArray", markers=[marker, marker]),
        "diagnostic_msgs/msg/DiagnosticArray": diagnostics,
        "trajectory_msgs/msg/JointTrajectory": motion,
        "std_srvs/srv/SetBool_Request": new("std_srvs/srv/SetBool_Request", data=True),
        "std_srvs/srv/SetBool_Response": new("std_srvs/srv/SetBool_Response", success=True, message="done"),
        "tf2_msgs/action/LookupTransform_SendGoal_Request": new(
            "tf2_msgs/action/LookupTransform_SendGoal_Request",
            goal_id=new("unique_identifier_msgs/msg/UUID", uuid=range(16)),
            goal=new("tf2_msgs/action/LookupTransform_Goal", target_frame="a", source_frame="b", advanced=True),
        ),
        "tf2_msgs/action/LookupTransform_GetResult_Response": new(
            "tf2_msgs/action/LookupTransform_GetResult_Response", status=4,
            result=new("tf2_msgs/action/LookupTransform_Result", transform=transform("b", 0.5, types)),
        ),
    }  # fmt: skip
