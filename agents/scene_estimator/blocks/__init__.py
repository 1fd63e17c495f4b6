"""Finds upright boxes and cylinders that nobody tagged, from depth, and keeps them apart."""

from agents.scene_estimator.blocks.block import Block
from agents.scene_estimator.blocks.clusters import Cluster, Support
from agents.scene_estimator.blocks.explained import KnownVolume
from agents.scene_estimator.blocks.finder import BlockFinder, BlockSighting, KnownBlock
from agents.scene_estimator.blocks.levelling import LevelledView, levelled
from agents.scene_estimator.blocks.splitting import cut, upright_box
from agents.scene_estimator.blocks.tracks import BlockTrack, assigned
from agents.scene_estimator.blocks.untagged import SeenBlocks, UntaggedObjects

__all__ = [
    "Block",
    "BlockFinder",
    "BlockSighting",
    "BlockTrack",
    "Cluster",
    "KnownBlock",
    "KnownVolume",
    "LevelledView",
    "SeenBlocks",
    "Support",
    "UntaggedObjects",
    "assigned",
    "cut",
    "levelled",
    "upright_box",
]
