"""The part of a `Memory` that carries camera frames and meshes: beside the graph, and the same in all worlds."""

from __future__ import annotations

from dsr.geometry.exchange import MeshExchange
from dsr.geometry.mesh import Mesh
from dsr.images.blobs import Frame, frame_chunks
from dsr.images.frame_reader import FrameReader
from dsr.network.keys import Keys
from dsr.network.transport import Transport


class BlobAccess:
    """Base of `Memory`."""

    keys: Keys
    transport: Transport
    meshes: MeshExchange

    def put_frame(self, name: str, frame: Frame) -> None:
        """Publish a camera frame under `name`; readers that are too slow skip frames."""
        self.transport.publish_bulk(self.keys.blob(name), frame_chunks(frame))

    def frames(self, name: str) -> FrameReader:
        """The stream of frames published elsewhere under `name`; close it after use."""
        return FrameReader(self.transport, self.keys.blob(name))

    def put_mesh(self, mesh: Mesh) -> str:
        """Have a mesh for whoever asks; returns its hash, for the attribute `mesh` of nodes. Nothing is sent yet."""
        return self.meshes.put(mesh)

    def mesh(self, hash: str, timeout: float = 5.0) -> Mesh:
        """The mesh with this hash: from memory, from disk, or else from any replica that has it; waits for that.

        Raises:
            MeshError: for what is no hash.
            MeshNotFoundError: if nobody gave it within `timeout` s; without threads, if it is not here yet.
        """
        return self.meshes.wait(hash, timeout)

    def get_mesh(self, hash: str) -> Mesh | None:
        """The same without waiting: None if it is not here, and it is asked for. Raises `MeshError`."""
        return self.meshes.get(hash)
