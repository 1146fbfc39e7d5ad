"""The systems of the paper's Table 2, and the unchanged recording as an answer to counterfactuals."""

from nsdr.baselines.q_type import PUBLISHED_Q_TYPE, q_type_answers, q_type_baselines
from nsdr.baselines.recording import keep_recording, tag_options

__all__ = ["PUBLISHED_Q_TYPE", "keep_recording", "q_type_answers", "q_type_baselines", "tag_options"]
