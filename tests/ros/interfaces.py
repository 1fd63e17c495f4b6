"""Writes an interface package of ROS 2 from our own definitions, for the real generators.

python -m tests.ros.interfaces tf2_msgs FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path

from agents.ros_bridge.messages import definitions

TF_MESSAGE = {"tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms"}
"""Which `rosbags` brings, and the real packages of the index do not"""
CMAKE = """cmake_minimum_required(VERSION 3.8)
project({name})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
{finds}
rosidl_generate_interfaces({name} {files} DEPENDENCIES {needs})
ament_package()
"""
MANIFEST = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name><version>0.0.0</version><description>For tests</description>
  <maintainer email="nobody@example.com">nobody</maintainer><license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
{needs}
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""


def texts(package: str) -> dict[str, str]:
    """The interface files of a package, by their place in it."""
    found = {}
    for name, parts in [
        *((name, (fields,)) for name, fields in {**definitions.MESSAGES, **TF_MESSAGE}.items()),
        *definitions.SERVICES.items(),
        *definitions.ACTIONS.items(),
    ]:
        owner, kind, short = name.split("/")
        if owner == package:
            lines = "\n---\n".join(part.replace(";", "\n") for part in parts)
            found[f"{kind}/{short}.{kind}"] = "\n".join(line.strip() for line in lines.splitlines()) + "\n"
    return found


def needed(package: str, files: dict[str, str]) -> list[str]:
    """Other packages whose messages are in these files."""
    types = [line.split()[0] for text in files.values() for line in text.splitlines() if line.strip("- ")]
    return sorted({type.partition("/")[0] for type in types if "/" in type} - {package})


def write_package(package: str, folder: Path) -> Path:
    """Write the package into a folder of its name in `folder`."""
    files = texts(package)
    needs = needed(package, files)
    place = folder / package
    for file, text in files.items():
        (place / file).parent.mkdir(parents=True, exist_ok=True)
        (place / file).write_text(text)
    finds = "\n".join(f"find_package({name} REQUIRED)" for name in needs)
    quoted = " ".join(f'"{file}"' for file in sorted(files))
    (place / "CMakeLists.txt").write_text(CMAKE.format(name=package, finds=finds, files=quoted, needs=" ".join(needs)))
    depends = "\n".join(f"  <depend>{name}</depend>" for name in needs)
    (place / "package.xml").write_text(MANIFEST.format(name=package, needs=depends))
    return place


if __name__ == "__main__":
    write_package(sys.argv[1], Path(sys.argv[2]))
