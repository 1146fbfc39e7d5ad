"""Attention and the encoding of time that several baselines share."""

import math

import torch
from torch import Tensor

__all__ = ["masked_softmax", "time_encoding"]

LONGEST_PERIOD = 10_000.0
"""Longest wavelength of the encoding of time, over 2 pi (Vaswani et al. 2017)."""


def masked_softmax(scores: Tensor, mask: Tensor) -> Tensor:
    """Weights (..., K) of K items by their scores (..., K); 0 for those whose mask (..., K) is False, even for all."""
    weights = scores.masked_fill(~mask, torch.finfo(scores.dtype).min).softmax(-1)
    return weights * mask


def time_encoding(frames: int, width: int, like: Tensor) -> Tensor:
    """Sines and cosines (frames, width) of each frame's index, with wavelengths from 2 pi frames on (Vaswani et al. 2017).

    Args:
        frames: number of frames.
        width: width of the encoding.
        like: a tensor with the device and number format of the result.
    """
    waves = (width + 1) // 2
    frequency = torch.exp(torch.arange(waves, device=like.device) * (-math.log(LONGEST_PERIOD) / waves))
    angle = torch.arange(frames, device=like.device)[:, None] * frequency
    return torch.cat([angle.sin(), angle.cos()], 1)[:, :width].to(like.dtype)
