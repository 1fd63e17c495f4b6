"""Real action servers of rclpy that play the controllers of an arm and its gripper; `node.py` runs them."""

from __future__ import annotations

from control_msgs.action import FollowJointTrajectory, GripperCommand
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future
from sensor_msgs.msg import JointState

HZ = 100.0
"""How often joints move and are told"""
KNUCKLE = "knuckle"
KNUCKLE_SPEED = 2.0  # rad/s


def seconds(duration):
    return duration.sec + duration.nanosec * 1e-9


class Arm:
    """A joint_trajectory_controller with its joints, and a position_controllers/GripperActionController.

    Args:
        node: of rclpy.
        joints: their names.
        held: rad at which the gripper's joint meets something; it closes from 0 to 0.8.
    """

    def __init__(self, node, joints, held):
        self.node, self.joints, self.held = node, joints, held
        self.at = [0.0] * len(joints)
        self.knuckle = 0.0
        self.goal = self.ended = self.grip = None
        self.points, self.begin, self.start = [], 0.0, self.at
        self.done = []
        self.states = node.create_publisher(JointState, "/joint_states", 10)
        self.servers = [
            ActionServer(
                node, FollowJointTrajectory, "/joint_trajectory_controller/follow_joint_trajectory", self.follow,
                goal_callback=self.accept, cancel_callback=lambda _: CancelResponse.ACCEPT,
            ),
            ActionServer(
                node, GripperCommand, "/gripper/gripper_cmd", self.squeeze,
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            ),
        ]  # fmt: skip
        node.create_timer(1.0 / HZ, self.step)

    def now(self):
        return self.node.get_clock().now().nanoseconds * 1e-9

    def accept(self, request):
        right = list(request.trajectory.joint_names) == self.joints
        return GoalResponse.ACCEPT if right else GoalResponse.REJECT

    async def follow(self, goal):
        if self.goal is not None:
            self.end("canceled" if self.goal.is_cancel_requested else "aborted")
        self.goal, self.ended = goal, Future()
        self.points = [(seconds(one.time_from_start), list(one.positions)) for one in goal.request.trajectory.points]
        self.begin, self.start = self.now(), list(self.at)
        how = await self.ended
        {"reached": goal.succeed, "canceled": goal.canceled, "aborted": goal.abort}[how]()
        self.done.append(how)
        return FollowJointTrajectory.Result()

    async def squeeze(self, goal):
        self.grip = (goal.request.command.position, Future())
        stalled = await self.grip[1]
        goal.succeed()
        return GripperCommand.Result(position=self.knuckle, stalled=stalled, reached_goal=not stalled)

    def end(self, how):
        self.goal, ended = None, self.ended
        ended.set_result(how)

    def step(self):
        if self.goal is not None:
            self.move()
        if self.grip is not None:
            self.close()
        message = JointState(name=[*self.joints, KNUCKLE], position=[*self.at, self.knuckle])
        message.header.stamp = self.node.get_clock().now().to_msg()
        self.states.publish(message)

    def move(self):
        if self.goal.is_cancel_requested:
            self.end("canceled")
            return
        passed, before = self.now() - self.begin, (0.0, self.start)
        for time, positions in self.points:
            if passed < time:
                share = (passed - before[0]) / (time - before[0])
                self.at = [a + share * (b - a) for a, b in zip(before[1], positions, strict=True)]
                return
            before = (time, positions)
        self.at = list(before[1])
        self.end("reached")

    def close(self):
        goal, ended = self.grip
        step = KNUCKLE_SPEED / HZ
        self.knuckle += max(-step, min(goal - self.knuckle, step))
        stalled = self.knuckle >= self.held
        if stalled:
            self.knuckle = self.held
        if stalled or abs(self.knuckle - goal) < 1e-6:
            self.grip = None
            ended.set_result(stalled)
