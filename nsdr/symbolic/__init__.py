"""The symbolic executor: programs, the signature table, the causal graph. Runs without PyTorch."""

from nsdr.symbolic.executor import Executor, format_trace
from nsdr.symbolic.modules import MODULES, WORDS, Kind, Module
from nsdr.symbolic.program import Program, Step

__all__ = ["MODULES", "WORDS", "Executor", "Kind", "Module", "Program", "Step", "format_trace"]
