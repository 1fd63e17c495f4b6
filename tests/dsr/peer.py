"""A process with a memory of its own that does what it is told on stdin, one JSON command a line."""

from __future__ import annotations

import json
import sys

import dsr


def main() -> None:
    """Obey until stdin ends."""
    memory = dsr.connect(sys.argv[1], agent=sys.argv[2])
    print(json.dumps({"rid": memory.rid, "joined": memory.joined}), flush=True)
    for line in sys.stdin:
        name, arguments = json.loads(line)
        print(json.dumps(perform(memory, name, arguments)), flush=True)
    memory.close()


def perform(memory: dsr.Memory, name: str, arguments: dict[str, object]) -> object:
    """Carry out one command and return what it found."""
    if name == "state":
        nodes = {node.name: [node.type, dict(node)] for node in memory.nodes()}
        edges = {str(edge.key): [list(edge.pose.t) if "pose" in edge else None] for edge in memory.edges()}
        return {"nodes": nodes, "edges": edges, "peers": memory.peers, "dropped": memory.dropped}
    if name == "many":
        for index in range(int(str(arguments["count"]))):
            memory.add_node(f"{arguments['prefix']}{index}", "ball")
        return None
    if name == "raw":
        memory.transport.publish(str(arguments["key"]), bytes.fromhex(str(arguments["payload"])))
        return None
    pose = arguments.pop("translation", None)
    if pose is not None:
        arguments["pose"] = dsr.Pose(pose)  # type: ignore[arg-type]
    positional = arguments.pop("args")
    try:
        getattr(memory, name)(*positional, **arguments)  # type: ignore[misc]
    except (dsr.NodeNotFoundError, dsr.NodeTypeError) as error:  # somebody else was faster
        return {"error": str(error)}
    return None


if __name__ == "__main__":
    main()
