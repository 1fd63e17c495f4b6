"""Writes the hashes of an interface package with the generators of real ROS; run in `.venv-ros`.

python hash_interfaces.py PACKAGE FOLDER SHARE
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from rosidl_adapter import convert_to_idl
from rosidl_generator_type_description import generate_type_hash


def main(package, folder, share):
    files = [file.relative_to(folder) for kind in ("msg", "srv", "action") for file in sorted(folder.glob(f"{kind}/*"))]
    tuples = []
    for file in files:
        made = convert_to_idl(folder, package, file, folder / file.parent)
        tuples.append(f"{folder}:{made.relative_to(folder)}")
    arguments = folder / "arguments.json"
    settings = {
        "package_name": package,
        "output_dir": str(folder / "hashes"),
        "idl_tuples": tuples,
        "include_paths": [f"{other.name}:{other}" for other in share.iterdir() if other.is_dir()],
    }
    arguments.write_text(json.dumps(settings))
    generate_type_hash(str(arguments))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
