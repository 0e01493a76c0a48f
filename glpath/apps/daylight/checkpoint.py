"""Checkpoint of daylight coefficients, which its owner keeps until the result is saved.

with DaylightCheckpoint(Path("dc.npz.part")) as checkpoint:
    found = daylight_coefficients(scene, points, normals, resume=checkpoint)
    found.save("dc.npz")
    checkpoint.remove()
"""

from __future__ import annotations

import os
from dataclasses import dataclass

from glpath.apps.daylight.kept_shards import KeptShards, remove_shards
from glpath.system.checkpoint import CheckpointFile


@dataclass
class DaylightCheckpoint(CheckpointFile):
    """Checkpoint file of words (`KeptWords`, `KeptPass`), or the folder of a cluster's shards (`KeptShards`)."""

    holder = "daylight coefficients that resume from it"

    def take_failure(self, kept: CheckpointFile | KeptShards) -> None:
        """Take over the failure of the file or folder that the computation wrote."""
        self.failure, self.rescue = kept.failure, kept.rescue

    def remove(self) -> None:
        """Remove the file, or the shards and their folder, if they exist. Raises ImageError if that fails."""
        if os.path.isdir(self.path):
            remove_shards(self.path)
        else:
            super().remove()
