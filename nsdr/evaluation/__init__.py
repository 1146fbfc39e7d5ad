"""Runs the pipeline over many videos, scores its answers, and makes the tables of `results/`."""

from nsdr.evaluation.batch import judge_videos, parse_videos, predict_dynamics
from nsdr.evaluation.experiments import run_experiment
from nsdr.evaluation.measures import accuracy_interval, calibration, wilson_interval
from nsdr.evaluation.runner import run_evaluation
from nsdr.evaluation.settings import EvaluationConfig
from nsdr.evaluation.sources import SOURCES, PerceptionInput, SceneSource

__all__ = [
    "SOURCES",
    "EvaluationConfig",
    "PerceptionInput",
    "SceneSource",
    "accuracy_interval",
    "calibration",
    "judge_videos",
    "parse_videos",
    "predict_dynamics",
    "run_evaluation",
    "run_experiment",
    "wilson_interval",
]
