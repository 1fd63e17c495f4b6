"""Definitions of messages, services and actions that `rosbags` does not bring, as plain field lists.

Each list was written from the public interface package that is named beside it, without its comments.
"""

from __future__ import annotations

MESSAGES: dict[str, str] = {
    # vision_msgs 4.1 (humble to lyrical)
    "vision_msgs/msg/Point2D": "float64 x; float64 y",
    "vision_msgs/msg/Pose2D": "vision_msgs/Point2D position; float64 theta",
    "vision_msgs/msg/BoundingBox2D": "vision_msgs/Pose2D center; float64 size_x; float64 size_y",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center; geometry_msgs/Vector3 size",
    "vision_msgs/msg/ObjectHypothesis": "string class_id; float64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": "ObjectHypothesis hypothesis; geometry_msgs/PoseWithCovariance pose",
    "vision_msgs/msg/Detection2D": (
        "std_msgs/Header header; ObjectHypothesisWithPose[] results; BoundingBox2D bbox; string id"
    ),
    "vision_msgs/msg/Detection2DArray": "std_msgs/Header header; Detection2D[] detections",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header; ObjectHypothesisWithPose[] results; BoundingBox3D bbox; string id"
    ),
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header; Detection3D[] detections",
    # apriltag_msgs 2.0
    "apriltag_msgs/msg/Point": "float64 x; float64 y",
    "apriltag_msgs/msg/AprilTagDetection": (
        "string family; int32 id; int32 hamming; float32 goodness; float32 decision_margin;"
        "Point centre; Point[4] corners; float64[9] homography"
    ),
    "apriltag_msgs/msg/AprilTagDetectionArray": "std_msgs/Header header; AprilTagDetection[] detections",
    # control_msgs 4.8 to 6.4
    "control_msgs/msg/JointTolerance": "string name; float64 position; float64 velocity; float64 acceleration",
    "control_msgs/msg/JointComponentTolerance": (
        "string joint_name; uint16 component; float64 position; float64 velocity; float64 acceleration"
    ),
    "control_msgs/msg/GripperCommand": "float64 position; float64 max_effort",
    # tf2_msgs 0.25 to 0.36
    "tf2_msgs/msg/TF2Error": "uint8 error; string error_string",
}  # fmt: skip
"""Fields by message type, separated by semicolons"""

SERVICES: dict[str, tuple[str, str]] = {
    # std_srvs 4.2 to 5.3
    "std_srvs/srv/Empty": ("", ""),
    "std_srvs/srv/SetBool": ("bool data", "bool success; string message"),
    "std_srvs/srv/Trigger": ("", "bool success; string message"),
    # action_msgs 1.2 to 2.0
    "action_msgs/srv/CancelGoal": ("GoalInfo goal_info", "int8 return_code; GoalInfo[] goals_canceling"),
    # example_interfaces 0.9 to 0.12
    "example_interfaces/srv/AddTwoInts": ("int64 a; int64 b", "int64 sum"),
    # tf2_msgs 0.25 to 0.36
    "tf2_msgs/srv/FrameGraph": ("", "string frame_yaml"),
    # our own, etc/ros/dsr_msgs
    "dsr_msgs/srv/Ask": ("string question", "bool success; string answer"),
    "dsr_msgs/srv/Transform": (
        "string target; string source; builtin_interfaces/Time stamp",
        "bool success; string message; geometry_msgs/PoseWithCovarianceStamped pose",
    ),
}
"""Fields of request and response by service type"""

ACTIONS: dict[str, tuple[str, str, str]] = {
    # control_msgs 4.8 and 5.8 (humble, iron, jazzy); since 6.3 its feedback has indices, see below
    "control_msgs/action/FollowJointTrajectory": (
        "trajectory_msgs/JointTrajectory trajectory; trajectory_msgs/MultiDOFJointTrajectory multi_dof_trajectory;"
        "JointTolerance[] path_tolerance; JointComponentTolerance[] component_path_tolerance;"
        "JointTolerance[] goal_tolerance; JointComponentTolerance[] component_goal_tolerance;"
        "builtin_interfaces/Duration goal_time_tolerance",
        "int32 error_code; string error_string",
        "std_msgs/Header header; string[] joint_names; trajectory_msgs/JointTrajectoryPoint desired;"
        "trajectory_msgs/JointTrajectoryPoint actual; trajectory_msgs/JointTrajectoryPoint error;"
        "string[] multi_dof_joint_names; trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_desired;"
        "trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_actual;"
        "trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_error",
    ),
    # control_msgs 4.8 to 6.4
    "control_msgs/action/GripperCommand": (
        "GripperCommand command",
        "float64 position; float64 effort; bool stalled; bool reached_goal",
        "float64 position; float64 effort; bool stalled; bool reached_goal",
    ),
    # control_msgs 4.8 to 6.8
    "control_msgs/action/ParallelGripperCommand": (
        "sensor_msgs/JointState command",
        "sensor_msgs/JointState state; bool stalled; bool reached_goal",
        "sensor_msgs/JointState state",
    ),
    # tf2_msgs 0.25 to 0.36
    "tf2_msgs/action/LookupTransform": (
        "string target_frame; string source_frame; builtin_interfaces/Time source_time;"
        "builtin_interfaces/Duration timeout; builtin_interfaces/Time target_time; string fixed_frame; bool advanced",
        "geometry_msgs/TransformStamped transform; TF2Error error",
        "",
    ),
}
"""Fields of goal, result and feedback by action type"""

_INDEXED = "control_msgs/action/FollowJointTrajectory"
_INDEXED_SINCE = ("kilted", "lyrical")


def actions(distro: str) -> dict[str, tuple[str, str, str]]:
    """`ACTIONS` as the release `distro` has them."""
    if distro not in _INDEXED_SINCE:
        return ACTIONS
    goal, result, feedback = ACTIONS[_INDEXED]
    feedback = feedback.replace("string[] multi_dof", "int32 index; string[] multi_dof") + "; int32 multi_dof_index"
    return {**ACTIONS, _INDEXED: (goal, result, feedback)}
