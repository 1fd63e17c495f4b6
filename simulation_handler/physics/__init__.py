"""The physics engine: one simulation, and rollouts of many scenes."""
