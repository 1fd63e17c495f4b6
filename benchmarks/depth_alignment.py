"""Depth in the image of colour: ours beside that of librealsense, on the same frames; processor time and agreement.

    python -m benchmarks.depth_alignment

The frames are those of a software device that librealsense records and plays: no camera is needed, but its library
(`pip install 'dsr-memory[realsense]'`). `ms` is processor time of one image, `ratio` ours over theirs. `both` is the
share of their known pixels that are known to us too, `ours` the share of ours that they know, and `same` the share of
pixels known to both that are as near within 2.5 mm.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from agents.cameras.realsense import load_library
from agents.cameras.realsense_lens import intrinsics_of, pose_of
from agents.depth_alignment import DepthAlignment
from agents.frame_images import Depth
from benchmarks.recorded_realsense import HEIGHT, WIDTH, record

_PATIENCE = 5000  # ms for the first frames
_SAME = 2.5e-3
"""m: theirs keeps the depth camera's own value, ours is along the axis of colour"""
_REPEATS = 20


class Aligned(NamedTuple):
    """One set of frames, aligned both ways."""

    ours: Depth
    theirs: Depth
    our_ms: float
    their_ms: float

    @property
    def both(self) -> float:
        """Share of their known pixels that are known to us too"""
        return float(((self.ours > 0) & (self.theirs > 0)).sum() / max((self.theirs > 0).sum(), 1))

    @property
    def known_to_them(self) -> float:
        """Share of our known pixels that are known to them too"""
        return float(((self.ours > 0) & (self.theirs > 0)).sum() / max((self.ours > 0).sum(), 1))

    @property
    def same(self) -> float:
        """Share of the pixels known to both that are equally near"""
        both = (self.ours > 0) & (self.theirs > 0)
        return float((np.abs(self.ours - self.theirs)[both] < _SAME).mean())


def aligned_both_ways(rs: Any, recording: Path, repeats: int = 1) -> Aligned:
    """The first frames of a recording, aligned by `DepthAlignment` and by librealsense (pyrealsense2 is `rs`)."""
    config = rs.config()
    config.enable_device_from_file(str(recording), repeat_playback=False)
    pipeline = rs.pipeline()
    profile = pipeline.start(config)
    try:
        streams = [profile.get_stream(kind).as_video_stream_profile() for kind in (rs.stream.depth, rs.stream.color)]
        (depth, _), (color, _) = (intrinsics_of(rs, stream.get_intrinsics()) for stream in streams)
        ours = DepthAlignment(depth, color, pose_of(streams[0].get_extrinsics_to(streams[1])))
        theirs = rs.align(rs.stream.color)
        came, frames = pipeline.try_wait_for_frames(_PATIENCE)
        if not came:
            raise RuntimeError(f"{recording} gave no frames")
        scale = np.float32(profile.get_device().first_depth_sensor().get_depth_scale())
        measured = np.asarray(frames.get_depth_frame().get_data()).astype(np.float32) * scale

        def align_theirs() -> Depth:
            image = theirs.process(frames).get_depth_frame()
            return np.array(image.get_data()).astype(np.float32) * scale

        our_ms, our_depth = _timed(lambda: ours.align(measured), repeats)
        their_ms, their_depth = _timed(align_theirs, repeats)
        return Aligned(our_depth, their_depth, our_ms, their_ms)
    finally:
        pipeline.stop()


def main() -> None:
    """Measure two sizes of images and print a row for each."""
    argparse.ArgumentParser("python -m benchmarks.depth_alignment", description=__doc__.partition("\n")[0]).parse_args()
    rs = load_library()
    table = Table("px", "ours ms", "theirs ms", "ratio", "both", "ours", "same")
    with tempfile.TemporaryDirectory() as folder:
        for scale in (1, 2):
            path = Path(folder) / f"seen{scale}.db3"
            record(rs, path, scale)
            found = aligned_both_ways(rs, path, _REPEATS)
            shares = (f"{share:.1%}" for share in (found.both, found.known_to_them, found.same))
            times = f"{found.our_ms:.1f}", f"{found.their_ms:.1f}", f"{found.our_ms / found.their_ms:.1f}"
            table.add_row(f"{WIDTH * scale} x {HEIGHT * scale}", *times, *shares)
    Console().print(table)


def _timed(align: Callable[[], Depth], repeats: int) -> tuple[float, Depth]:
    """Processor time of one call, ms, and what it gives."""
    found = align()
    began = time.process_time()
    for _ in range(repeats):
        found = align()
    return 1e3 * (time.process_time() - began) / repeats, found


if __name__ == "__main__":
    main()
