"""Names of devices and number formats."""

from typing import Any

from nsdr.errors import DataError

__all__ = ["PRECISIONS", "has_bfloat16", "resolve_device", "resolve_precision"]

PRECISIONS = ("auto", "float32", "bfloat16")
"""Number formats of convolutions."""
CPU_CHECK = "_is_amx_tile_supported"
"""Function of `torch.cpu` that says whether the processor multiplies bfloat16 matrices (AMX). Without, bfloat16 is slower than
float32: `ONEDNN_MAX_CPU_ISA=AVX512_CORE_BF16 python benchmarks/frame_parser.py … --precision float32 bfloat16`."""


def resolve_device(device: str = "auto") -> Any:
    """The `torch.device` of a name; "auto" is CUDA where there is one, else the CPU.

    Raises:
        DataError: an unknown device, or one that is not there.
    """
    import torch

    if device == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        found = torch.device(device)
        torch.empty(0, device=found)
    except (RuntimeError, AssertionError) as e:
        reason = str(e).splitlines()[0]
        raise DataError(f"device {device!r} cannot be used ({reason}); expected auto, cpu, cuda or cuda:N") from e
    return found


def resolve_precision(precision: str, device: Any) -> Any:
    """The `torch.dtype` of a name; "auto" is bfloat16 where the `torch.device` multiplies matrices of it, else float32.

    Raises:
        DataError: an unknown name.
    """
    if precision not in PRECISIONS:
        raise DataError(f"precision is {precision!r}; expected one of {', '.join(PRECISIONS)}")
    import torch

    if precision != "auto":
        return torch.bfloat16 if precision == "bfloat16" else torch.float32
    if device.type == "cuda":
        fast = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        fast = device.type == "cpu" and getattr(torch.cpu, CPU_CHECK, bool)()
    return torch.bfloat16 if fast else torch.float32


def has_bfloat16() -> bool:
    """Whether all layers run in bfloat16 on this processor, fast or slow: LSTMs need AVX-512."""
    import torch

    return not torch.backends.mkldnn.is_available() or bool(torch.ops.mkldnn._is_mkldnn_bf16_supported())
