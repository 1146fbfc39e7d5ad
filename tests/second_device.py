"""A second device on a machine without an accelerator: its tensors hold CPU tensors, but report "meta".

As on CUDA, an operation on tensors of both devices fails, and so does `.numpy()` on one that was not brought to the CPU. As on
MPS, there are no numbers of double precision.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten, tree_map

DEVICE = torch.device("meta")
CPU = torch.device("cpu")


class SecondTensor(torch.Tensor):
    """A tensor of the second device."""

    held: torch.Tensor

    @staticmethod
    def __new__(cls, held: torch.Tensor) -> "SecondTensor":
        if held.dtype == torch.float64:
            raise TypeError(f"{DEVICE} has no float64")
        made = torch.Tensor._make_wrapper_subclass(
            cls,
            held.size(),
            strides=held.stride(),
            storage_offset=held.storage_offset(),
            dtype=held.dtype,
            device=DEVICE,
        )
        made.held = held
        return made

    @classmethod
    def __torch_dispatch__(cls, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return _dispatch(function, args, kwargs or {})

    def __repr__(self) -> str:
        return f"SecondTensor({self.held})"

    def numpy(self, *args: Any, **kwargs: Any) -> Any:
        raise TypeError(f"can't convert {DEVICE} device type tensor to numpy. Use Tensor.cpu() first")

    def tolist(self) -> Any:
        return self.cpu().tolist()


class _Mode(TorchDispatchMode):
    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return _dispatch(function, args, kwargs or {})


class _FromData(TorchFunctionMode):
    """Tensors from lists and arrays are made on the CPU and then copied, because they pass by `__torch_dispatch__`."""

    def __torch_function__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        device = kwargs.get("device")
        if function in (torch.tensor, torch.as_tensor) and device is not None and torch.device(device) == DEVICE:
            return function(*args, **{**kwargs, "device": CPU}).to(DEVICE)
        if function is torch.Tensor.new_tensor and isinstance(args[0], SecondTensor):
            return args[0].held.new_tensor(*args[1:], **kwargs).to(DEVICE)
        return function(*args, **kwargs)


def _dispatch(function: Any, args: Any, kwargs: Any) -> Any:
    leaves = [x for x in tree_flatten((args, kwargs))[0] if isinstance(x, torch.Tensor)]
    here = [x for x in leaves if isinstance(x, SecondTensor)]
    # As on CUDA, a CPU tensor may join in only where it is a scalar, an index, or what is copied.
    copies = function.overloadpacket in (torch.ops.aten.copy_, torch.ops.aten._to_copy, torch.ops.aten.index)
    strays = [x for x in leaves if not isinstance(x, SecondTensor) and x.dim() and not copies]
    packed = "_pack_padded" in str(function) or "lstm" in str(function)  # lengths stay on the CPU
    if here and strays and not packed:
        raise RuntimeError(f"{function}: expected all tensors to be on the same device, found {DEVICE} and cpu")
    target = kwargs.get("device")
    on_second = bool(here) if target is None else torch.device(target).type == DEVICE.type
    if function.overloadpacket is torch.ops.aten.copy_:
        on_second = isinstance(args[0], SecondTensor)
    if target is not None:
        kwargs = {**kwargs, "device": CPU}
    plain_args, plain_kwargs = tree_map(lambda x: x.held if isinstance(x, SecondTensor) else x, (args, kwargs))
    result = function(*plain_args, **plain_kwargs)
    if function._schema.is_mutable and leaves and not isinstance(result, tuple | list):
        return args[0] if isinstance(args[0], torch.Tensor) else result
    if function.overloadpacket is torch.ops.aten._pack_padded_sequence and on_second:
        return SecondTensor(result[0]), result[1]  # sizes stay on the CPU
    return tree_map(lambda x: SecondTensor(x) if on_second and isinstance(x, torch.Tensor) else x, result)


@contextmanager
def second_device() -> Iterator[torch.device]:
    """Within the block, tensors and modules can be moved to the device that is yielded."""
    before = torch.__future__.get_swap_module_params_on_conversion()
    torch.__future__.set_swap_module_params_on_conversion(True)
    try:
        with _Mode(), _FromData():
            yield DEVICE
    finally:
        torch.__future__.set_swap_module_params_on_conversion(before)
