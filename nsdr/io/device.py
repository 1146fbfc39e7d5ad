"""Names of devices."""

from typing import Any

from nsdr.errors import DataError

__all__ = ["resolve_device"]


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
