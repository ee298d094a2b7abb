"""Where torch computes: on a GPU when there is one, else on the processor, with the same code."""

from __future__ import annotations

import torch


def device() -> torch.device:
    """The first GPU, or the processor."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")
