"""Opens the connection that a configuration asks for."""

from __future__ import annotations

from agents.ros_bridge.link.link import LinkConfig, RosLink


def open_link(config: LinkConfig, node: str) -> RosLink:
    """Connect to ROS 2 as the node of this full name, for example `/dsr_bridge`.

    Raises:
        RosLinkError: if the configuration reaches beyond this machine without saying so, or cannot be used.
        RosMessageError: for an unknown release of ROS 2, or a malformed name.
    """
    if config.transport == "dds":
        from agents.ros_bridge.link.dds.dds_link import DdsLink  # an extra of its own

        return DdsLink(config, node)
    from agents.ros_bridge.link.zenoh.zenoh_link import ZenohLink

    return ZenohLink(config, node)
