"""Command line and YAML -> one frozen dataclass: defaults, then the file, then the flags; unknown keys are errors."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import jsonargparse

__all__ = ["described", "parse_config", "resolved"]

T = TypeVar("T")


def parse_config(kind: type[T], argv: Sequence[str] | None, program: str) -> T:
    """The configuration `kind` from arguments such as `["--config", "a.yaml", "--loop.steps", "10"]`."""
    parser = jsonargparse.ArgumentParser(
        prog=program, description=(kind.__doc__ or "").splitlines()[0], exit_on_error=False
    )
    parser.add_argument("--config", action="config", help="a YAML file; flags after it win")
    parser.add_class_arguments(kind, sub_configs=True)
    arguments = parser.parse_args(argv if argv is None else list(argv))
    values = parser.instantiate(arguments).as_dict()
    values.pop("config")
    return kind(**values)


def resolved(config: Any) -> dict[str, Any]:
    """The configuration as plain values, without the position of its run folder (which may move)."""
    values = asdict(config)
    values.pop("run_dir", None)
    values.pop("output", None)
    return values


def described(config: Any) -> dict[str, Any]:
    """The configuration for readers of a checkpoint: of every path only the last part, which says nothing of the machine."""
    return {k: Path(v).name if isinstance(v, str) and "/" in v else v for k, v in resolved(config).items()}
