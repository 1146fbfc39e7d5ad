"""Curves and images of a training run for TensorBoard."""

import os
import socket
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.io.files import writing

__all__ = ["EventFile"]

FORMAT = "brain.Event:2"
"""Version of the file format, which its first event names."""


class EventFile:
    """Events of a run, each in the file as soon as it is added: unlike with `SummaryWriter`, no thread loses them in a kill.

    Args:
        folder: of the run.
        start: number of finished steps; events of later steps in the folder's earlier files are hidden.

    Raises:
        ImportError: TensorBoard is not installed.
        DataError: the folder cannot be written; so in every method.
    """

    def __init__(self, folder: Path, start: int) -> None:
        from tensorboard.compat.proto.event_pb2 import SessionLog

        self.path = folder / f"events.out.tfevents.{time.time_ns() // 10**9}.{socket.gethostname()}.{os.getpid()}"
        self._add(file_version=FORMAT)
        self._add(step=start + 1, session_log=SessionLog(status=SessionLog.START))

    def add_scalar(self, name: str, value: float, step: int) -> None:
        """A point of a curve."""
        from torch.utils.tensorboard.summary import scalar  # heavy

        self._add(step=step, summary=scalar(name, value))

    def add_image(self, name: str, image: NDArray[np.uint8], step: int) -> None:
        """An RGB image (H, W, 3)."""
        from torch.utils.tensorboard.summary import image as summary_of_image

        self._add(step=step, summary=summary_of_image(name, image, dataformats="HWC"))

    def _add(self, **content: Any) -> None:
        from tensorboard.compat.proto.event_pb2 import Event
        from tensorboard.summary.writer.record_writer import RecordWriter

        with writing(self.path), self.path.open("ab") as file:
            RecordWriter(file).write(Event(wall_time=time.time(), **content).SerializeToString())
