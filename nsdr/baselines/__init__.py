"""Baselines of the paper's Table 2, one system per module."""

from nsdr.baselines.q_type import PUBLISHED_Q_TYPE, q_type_baselines

__all__ = ["PUBLISHED_Q_TYPE", "q_type_baselines"]
