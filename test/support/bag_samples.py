"""What a bag holds, as the package reads it."""

from pathlib import Path

import numpy as np

from wrist_ft_comp.recording import Topics
from wrist_ft_comp.recordings.bag import read_bag
from wrist_ft_comp.recordings.read import open_bag


def read(path, topics=None):
    """Stamps and values by channels, and the bag's warnings."""
    parts = {}
    with open_bag(Path(path)) as bag:
        for block in read_bag(bag, topics or Topics()):
            parts.setdefault(block.channels, []).append((block.stamps_ns, block.values))
        joined = {
            channels: tuple(map(np.concatenate, zip(*blocks, strict=True)))
            for channels, blocks in parts.items()
        }
        return joined, bag.warnings
