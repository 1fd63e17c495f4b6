"""Grasps: where a gripper can hold a thing, how it closes, and what it holds."""
