"""What does a recording cost? Records the traffic of a recording again, with other settings: MB a minute and CPU.

    dsr record --folder runs/all --frames-hz 30 --still-hz 30 --lossless --for 60
    python -m benchmarks.recording runs/all
    python -m benchmarks.recording runs/all --json recording.json

The recording that is given should hold every image with every bit, as above; its images are published again as their
camera had published them. The recorder works as in a running system, on a manual clock and a network in memory. The CPU
time is that of its ticks: choosing, packing, compressing, writing. Receiving the messages is not in it.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from time import process_time  # CPU time is what is measured here
from typing import Any

from rich.console import Console
from rich.table import Table

from agents.recorder import Recorder
from agents.recorder.channels import SNAPSHOT
from agents.recorder.contents import contents_of
from agents.recorder.images import unpack
from agents.recorder.index import RecordingIndex
from dsr import LocalNetwork, ManualClock, Memory
from dsr.agent import make_agent
from dsr.errors import WireError
from dsr.images.blobs import decode_frame, encode_frame
from dsr.network.keys import Keys

SETTINGS: dict[str, dict[str, Any]] = {
    "as set by default": {},
    "still scenes as often as others": {"still_hz": 2.0},
    "flushed every 0.4 s": {"flush_period": 0.4},
    "images without loss": {"lossless": True},
    "every image": {"frames_hz": 30.0, "still_hz": 30.0},
    "no images": {"without": ["images"]},
    "the graph alone": {"only": ["graph", "streams", "meshes"]},
    "files of 5 s": {"rotate_period": 5.0},
}
"""Configurations of the recorder that are compared."""
_KEYS = Keys("recording")
_TICK = 1 / Recorder.rate_hz  # s


def main() -> None:
    """Measure what the command line asks for and print a row for each configuration."""
    options = _parser().parse_args()
    index = RecordingIndex(options.recording)
    rows = [measured(index, name, config) for name, config in SETTINGS.items()]
    Console().print(_table(rows))
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.recording", description=__doc__.partition("\n")[0])
    parser.add_argument("recording", type=Path, help="with every image, without loss: a file, or the folder of a run")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    return parser


def measured(index: RecordingIndex, name: str, config: dict[str, Any]) -> dict[str, Any]:
    """Record the traffic of a recording again: MB a minute, of images and else, and ms of CPU a recorded second."""
    with tempfile.TemporaryDirectory() as folder:
        cpu = record_again(index, Path(folder), config)
        contents = contents_of(folder)
    minutes = contents.seconds / 60.0
    images = sum(it.packed for it in contents.channels if it.channel.startswith("blob/")) / 1e6
    return {
        "settings": name,
        "MB/min": contents.mb_per_minute,
        "MB/min of blobs": images / minutes,
        "CPU ms/s": 1000.0 * cpu / contents.seconds,
        "files": len(contents.files),
    }


def record_again(index: RecordingIndex, folder: Path, config: dict[str, Any]) -> float:
    """Publish the messages of a recording for a recorder with this configuration; the CPU time (s) of its ticks."""
    clock = ManualClock()
    network = LocalNetwork(clock)
    heard = Memory(_KEYS.graph, "recorder", transport=network.connect("recorder"), clock=clock)
    heard.replica.synchroniser.nobody_there()  # nobody else holds the graph
    bus = network.connect("others")
    settings = {"folder": str(folder), **config}
    recorder = make_agent(
        Recorder, name="recorder", config=settings, bus=heard.transport, keys=_KEYS, clock=clock, memory=heard
    )
    recorder.setup()
    begun, next_tick, cpu = clock.now(), _TICK, 0.0
    for record in index.read_for(0.0):
        while record.time >= next_tick:
            clock.advance_to(begun + next_tick)
            network.deliver()
            heard.poll()
            before = process_time()
            recorder.tick(clock.now())
            cpu += process_time() - before
            next_tick += _TICK
        if record.topic == SNAPSHOT:
            heard.restore(record.payload)
        elif record.topic != "mesh":
            bus.publish(f"{_KEYS.root}/{record.topic}", _as_published(record.topic, record.payload))
    recorder.teardown()
    return cpu


def _as_published(topic: str, payload: bytes) -> bytes:
    if not topic.startswith("blob/"):
        return payload
    try:
        return encode_frame(unpack(decode_frame(payload)))
    except WireError:
        return payload


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="recorded again")
    for heading in rows[0]:
        table.add_column(heading, justify="left" if heading == "settings" else "right")
    for row in rows:
        table.add_row(*(f"{value:.2f}" if isinstance(value, float) else str(value) for value in row.values()))
    return table


if __name__ == "__main__":
    main()
