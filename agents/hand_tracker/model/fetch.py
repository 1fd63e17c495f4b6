"""Gets the model out of a wheel of the package mediapipe: from the package index that pip is configured for, or a file.

The wheel is data here: nothing of it is installed or run, and only the two networks are kept.
"""

from __future__ import annotations

import errno
import importlib.util
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

from agents.hand_tracker.model.files import DETECTOR, LANDMARKER, MOST_BYTES, UNREADABLE, VERSION, check_contents
from dsr.errors import ConfigError

WHEEL = "05dc4a9e593655a79558d05d6227d31018c2537a4bd3362b51e230cf22aecfe3"
"""SHA-256 of the wheel that is asked for: one for Python 3.11 on Linux x86-64, whatever runs here."""
WHEEL_BYTES = 35_622_638
OFFLINE = (
    f"Without a network: get a wheel of mediapipe {VERSION} elsewhere, by "
    f"`pip download --no-deps --only-binary :all: --python-version 3.11 --platform manylinux_2_28_x86_64 "
    f"mediapipe=={VERSION}`, and name the file with --from-wheel."
)
_ENTRIES = {
    DETECTOR: "mediapipe/modules/palm_detection/palm_detection_full.tflite",
    LANDMARKER: "mediapipe/modules/hand_landmark/hand_landmark_full.tflite",
}
_ASKED = ("--python-version", "3.11", "--implementation", "cp", "--platform", "manylinux_2_28_x86_64")
_REASONS = (
    ("No space left on device", "there is no room on the disk for the wheel (36 MB)"),
    ("DO NOT MATCH THE HASHES", f"what came has the wrong checksum: it is not the published wheel of {VERSION}"),
    ("No matching distribution", f"the package index does not have mediapipe {VERSION}, or cannot be reached"),
    ("Could not find a version", f"the package index does not have mediapipe {VERSION}, or cannot be reached"),
    ("Temporary failure in name resolution", "the package index cannot be reached"),
    ("Connection", "the package index cannot be reached"),
)
"""What pip says, and what that means; the first that fits."""

_STANDARD_ERROR = 2  # the number of its file: standard output is for results

Say = Callable[[str], None]


def from_index(say: Say, *, quiet: bool = False) -> Mapping[str, bytes]:
    """The two networks, downloaded as pip downloads: by its configuration, proxies and certificates.

    Args:
        say: told what goes on, a line at a time.
        quiet: pip shows no progress.

    Raises:
        ConfigError: if the wheel cannot be had, or is another one.
    """
    if importlib.util.find_spec("pip") is None:
        raise ConfigError(f"this Python ({sys.executable}) has no pip to download with. {OFFLINE}")
    with tempfile.TemporaryDirectory(prefix="dsr-hands-") as folder:
        wanted = Path(folder) / "wanted.txt"
        wanted.write_text(f"mediapipe=={VERSION} --hash=sha256:{WHEEL}\n", encoding="ascii")
        say(f"downloading mediapipe {VERSION} ({WHEEL_BYTES / 1e6:.0f} MB), of which 8 MB are kept")
        _download([*_ASKED, "--require-hashes", "-r", str(wanted), "-d", folder], quiet=quiet)
        (wheel,) = Path(folder).glob("*.whl")
        return from_wheel(wheel)


def from_wheel(wheel: Path) -> Mapping[str, bytes]:
    """The two networks in a wheel of mediapipe. Raises `ConfigError` if it has none, or others."""
    name = str(wheel)
    try:
        if not wheel.is_file():  # a device may never end
            raise ConfigError(f"no wheel {name!r}. {OFFLINE}")
        with zipfile.ZipFile(wheel) as archive:
            sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
            missing = [entry for entry in _ENTRIES.values() if not 0 < sizes.get(entry, 0) <= MOST_BYTES]
            contents = {} if missing else {ours: archive.read(theirs) for ours, theirs in _ENTRIES.items()}
    except UNREADABLE as error:
        raise ConfigError(f"{name!r} cannot be read as a wheel ({error}). {OFFLINE}") from error
    if missing:
        lacking = f"lacks {', '.join(missing)}, of at most {MOST_BYTES} bytes"
        raise ConfigError(f"{name!r} {lacking}: expected a wheel of mediapipe {VERSION}")
    check_contents(contents, name)
    return contents


def check_place(file: Path) -> None:
    """Raise `ConfigError` unless a model can be put at `file`, before anything is downloaded for it."""
    try:
        if file.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder", str(file))
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=file.parent):
            pass
    except OSError as error:
        raise ConfigError(f"the model would not be kept: {why_not_written(error, file)}") from error


def why_not_written(error: OSError, file: Path) -> str:
    """What to tell about a model that cannot be put at `file`."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        free = _free(file.parent)
        return f"there is no room for {file} ({free:.0f} MB are free, 8 MB are needed)"
    return f"{file} cannot be written ({error}); choose another place with --to"


def _free(folder: Path) -> float:
    """MB that are free where a folder is, or would be."""
    there = next((place for place in (folder, *folder.parents) if place.exists()), Path("/"))
    return shutil.disk_usage(there).free / 1e6


def _download(options: list[str], *, quiet: bool) -> None:
    """Let pip download; its progress is seen, its complaints become the error. Ends pip on Ctrl-C."""
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "download", "--no-deps"]
    command += ["--only-binary", ":all:", *(["--progress-bar", "off"] if quiet else []), *options]
    output = subprocess.DEVNULL if quiet else _STANDARD_ERROR
    with subprocess.Popen(command, stdout=output, stderr=subprocess.PIPE, text=True) as pip:
        try:
            _, said = pip.communicate()
        except BaseException:
            pip.terminate()
            raise
    if pip.returncode:
        lines = [line.strip() for line in said.splitlines() if line.strip() and not line.startswith("WARNING")]
        reason = next((meaning for words, meaning in _REASONS if words in said), "pip could not download it")
        last = f" (pip: {lines[-1]})" if lines else ""
        raise ConfigError(f"the model was not fetched: {reason}{last}. {OFFLINE}")
