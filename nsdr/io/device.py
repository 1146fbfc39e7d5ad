"""Where networks run: devices, number formats, and threads, of which idle ones sleep: a busy machine then costs a share."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from importlib import import_module
from threading import Lock, local
from types import ModuleType
from typing import Any

from nsdr.errors import DataError

PASSIVE = {"OMP_WAIT_POLICY": "PASSIVE", "KMP_BLOCKTIME": "0"}
"""Idle threads of GNU's OpenMP (in torch's wheels for Linux) and of LLVM's or Intel's sleep at once."""
WAITING = (*PASSIVE, "GOMP_SPINCOUNT")
"""Environment variables with which users decide how idle OpenMP threads wait."""
PRECISIONS = ("auto", "float32", "bfloat16")
"""Number formats of convolutions."""
WORKER_GPU_BYTES = 2 * 2**30
"""GPU memory of a process from video to answer: four of them used 7.4 GiB, with batches of 32 (`results/gpu.md`)."""
CPU_CHECK = "_is_amx_tile_supported"
"""Function of `torch.cpu` that says whether the processor multiplies bfloat16 matrices (AMX). Without, bfloat16 is slower than
float32: `ONEDNN_MAX_CPU_ISA=AVX512_CORE_BF16 python -m benchmarks.frame_parser … --precision float32 bfloat16`."""


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


def workers_on(device: Any, workers: int) -> int:
    """Number of processes whose networks run on a `torch.device`: `workers`, or where that is 0 as many as fit.

    Returns:
        0, which is one process for each CPU core, but on CUDA at most as many as the GPU's memory is enough for.
    """
    import torch

    if workers or device.type != "cuda":
        return workers
    most = torch.cuda.get_device_properties(device).total_memory // WORKER_GPU_BYTES
    return max(min(available_cores(), most), 1)


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


@contextmanager
def exact_convolutions() -> Iterator[None]:
    """Within it, convolutions on CUDA are computed in float32, not in TF32, whose significand has 10 bits. Also a decorator."""
    import torch

    before = torch.backends.cudnn.allow_tf32
    torch.backends.cudnn.allow_tf32 = False
    try:
        yield
    finally:
        torch.backends.cudnn.allow_tf32 = before


@contextmanager
def without_compiler() -> Iterator[None]:
    """For the import of torchvision's detectors: RoIAlign loads torch's compiler only to ask whether a device can use it.

    Without this, `Pipeline.from_pretrained` took 6.1 s of CPU time instead of 4.4 s (medians of six runs by turns, on a busy
    machine).
    """
    name = "torch._dynamo.utils"
    stand_in = ModuleType(name)
    stand_in.__dict__["is_compile_supported"] = lambda device: import_module(name).is_compile_supported(device)
    is_ours = sys.modules.setdefault(name, stand_in) is stand_in
    try:
        yield
    finally:
        if is_ours:
            del sys.modules[name]


def has_bfloat16() -> bool:
    """Whether all layers run in bfloat16 on this processor, fast or slow: LSTMs need AVX-512."""
    import torch

    return not torch.backends.mkldnn.is_available() or bool(torch.ops.mkldnn._is_mkldnn_bf16_supported())


def passive_environment() -> dict[str, str]:
    """Environment variables with which idle OpenMP threads sleep instead of spin; {} where the user has set how they wait."""
    return {} if any(name in os.environ for name in WAITING) else PASSIVE


@contextmanager
def passive_threads() -> Iterator[None]:
    """Set the variables of `passive_environment` while torch is loaded within this context.

    Afterwards they are removed, so that other programs of the user do not inherit them.
    Runtimes read these variables once, when they are loaded: without effect after `import torch`.
    """
    added = {} if "torch" in sys.modules else passive_environment()
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)


def available_cores() -> int:
    """CPU cores this process may use: those of its affinity, or the CPU quota of its control group where that is less."""
    from loky import cpu_count

    return int(cpu_count())


_inside = local()
"""`threads`: torch's within the calling thread's innermost limit, or missing."""
_lock = Lock()
"""Guards `_before`."""
_before: list[int] = []
"""For each limit in force in any thread, the threads that torch had before the first of them."""
_blas = Lock()
"""Held by the thread that limits BLAS, whose number of threads is one for the whole process."""


@contextmanager
def limit_threads(most: int | None = None) -> Iterator[None]:
    """Within it, torch uses `most` threads at most in the calling thread, and BLAS (NumPy, SciPy) one. Also a decorator.

    A user's smaller setting stays, and what was set before is restored at the end. Several threads of a program may be
    within it at once; then BLAS is limited until the first of them leaves.

    Args:
        most: threads of torch; None is one for each available core.
    """
    import torch
    from threadpoolctl import ThreadpoolController

    with _lock:
        now = torch.get_num_threads()  # also lets a new thread take over what others have set now, not later
        _before.append(_before[0] if _before else now)
        outer, mine = getattr(_inside, "threads", None), _before[0]
    has_blas = _blas.acquire(blocking=False)
    try:
        _inside.threads = min(available_cores() if most is None else most, outer or mine)
        torch.set_num_threads(_inside.threads)
        with ThreadpoolController().select(user_api="blas").limit(limits=1) if has_blas else nullcontext():
            yield
    finally:
        _inside.threads = outer
        torch.set_num_threads(outer or mine)
        with _lock:
            _before.pop()
        if has_blas:
            _blas.release()
