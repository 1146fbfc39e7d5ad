"""The symbolic executor: programs, the signature table and the causal graph. Runs without PyTorch."""

from nsdr.symbolic.executor import Executor
from nsdr.symbolic.modules import MODULES, WORDS, Kind, Module
from nsdr.symbolic.official import OfficialExecutor
from nsdr.symbolic.program import Program, Step
from nsdr.symbolic.traces import format_trace, format_tree

__all__ = [
    "MODULES",
    "WORDS",
    "Executor",
    "Kind",
    "Module",
    "OfficialExecutor",
    "Program",
    "Step",
    "format_trace",
    "format_tree",
]

VERSION = 5
"""Of the answers of programs: raised when they change."""
