"""Reads one file as the product would, for a process of its own: `python -m benchmarks.attacks.files.reading FILE`.

Exit 0 if it was read, 3 if it was refused with an error of the project's own, which is printed.
"""

from __future__ import annotations

import resource
import sys
from pathlib import Path

REFUSED = 3
"""Exit code of a clear refusal."""
MEMORY = 4 << 30
"""Bytes of address space that reading may take: libraries alone reserve about one GiB."""
SECONDS = 30
"""CPU seconds that reading may take, with the second or two of its imports."""


def main() -> None:
    """Read the file that the command line names, with every reader that takes files of its kind."""
    from dsr.errors import DsrError

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    try:
        read(Path(sys.argv[1]))
    except DsrError as error:
        print(error)
        sys.exit(REFUSED)


def read(file: Path) -> None:
    """Read `file` by its ending. Raises `DsrError`, and whatever a reader should not raise."""
    if file.suffix == ".mcap":
        from agents.recorder.reader import read_recording

        recording = read_recording(file)
        for _ in recording:
            pass
        print(*recording.reports, sep="\n")
    elif file.suffix == ".json":
        from dsr.persistence.files import read_graph

        for warning in read_graph(file).warnings:
            print(warning)
    elif file.suffix == ".toml":
        _toml(file)
    elif file.suffix == ".urdf":
        _urdf(file)
    elif file.suffix in (".png", ".jpeg"):
        import numpy as np

        from agents.recorder.images import unpack
        from dsr.images.blobs import Frame

        name = "depth.png" if file.suffix == ".png" else "color.jpeg"
        unpack(Frame(0.0, {name: np.frombuffer(file.read_bytes(), np.uint8)}, {}))
    else:
        from dsr.geometry.files import load_model

        load_model(file)


def _toml(file: Path) -> None:
    """As a system and as a scenario; both must refuse it."""
    from agents.scenario.format.scenario import load_scenario
    from dsr.errors import DsrError
    from dsr.runtime.system import load_system

    try:
        load_system(file)
    except DsrError:
        load_scenario(file)


def _urdf(file: Path) -> None:
    """As a robot and as an object; both must refuse it."""
    from agents.arm_controller.model.urdf import load_robot
    from agents.object_models import load_model as load_object
    from dsr.errors import DsrError

    try:
        load_robot(file)
    except DsrError:
        load_object(file)


if __name__ == "__main__":
    main()
