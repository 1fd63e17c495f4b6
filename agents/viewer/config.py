"""The configuration of the viewer."""

from __future__ import annotations

import math

import msgspec

from agents.viewer.window import LOOPBACK

_LAST_PORT = 65_535


class ViewerConfig(msgspec.Struct, frozen=True):
    """Which data the viewer shows, and where."""

    folder: str = "runs/viewer"
    """Gets `recording.rrd`, or `recording-2.rrd` if that exists, and so on."""
    record: bool = True
    """Write the file; without it, nothing is left when the window or the server ends."""
    keep_mb: float = 0.0
    """MB that all files `recording*.rrd` of the folder may take together; 0 for any. When a file has an eighth of it,
    the next one begins, and the oldest go."""
    spawn: bool = False
    """Open the rerun window as well."""
    serve: bool = False
    """Serve the view to browsers and to rerun viewers elsewhere."""
    bind: str = LOOPBACK
    """Address of this machine at which the view is served; `0.0.0.0` for all, which others can reach, too."""
    port: int = 9876
    """TCP port of the served data: the one that rerun's viewers try by themselves."""
    web_port: int = 9090
    """TCP port of the served page: the one that rerun takes by itself."""
    awaits_start: bool = False
    """A scenario will start, from which seconds count. Otherwise they count from the first look."""
    listens: float = 0.0
    """Seconds before the first look, if nobody tells a time 0: for a view of what may run already."""
    images_hz: float = 5.0
    """Camera images a second and camera."""
    jpeg_quality: int = 80
    """JPEG quality of camera images, 1 to 100."""
    memory_limit: str = "1GB"
    """Memory that the window may use until it forgets the oldest data."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.images_hz) and self.images_hz > 0):
            raise ValueError(f"images_hz {self.images_hz}: expected a positive number")
        if not (math.isfinite(self.listens) and self.listens >= 0):
            raise ValueError(f"listens {self.listens}: expected a finite number of seconds, at least 0")
        if not (math.isfinite(self.keep_mb) and self.keep_mb >= 0):
            raise ValueError(f"keep_mb {self.keep_mb}: expected a finite number, 0 or more")
        if not 1 <= self.jpeg_quality <= 100:
            raise ValueError(f"jpeg_quality {self.jpeg_quality}: expected 1 to 100")
        for name in ("port", "web_port"):
            if not 1 <= getattr(self, name) <= _LAST_PORT:
                raise ValueError(f"{name} {getattr(self, name)}: expected 1 to {_LAST_PORT}")
        if self.port == self.web_port:
            raise ValueError(f"port {self.port}: expected another one than web_port")
        if not (self.record or self.spawn or self.serve):
            raise ValueError("record, spawn and serve are all false: nothing would be shown anywhere")
