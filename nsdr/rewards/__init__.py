"""Rewards for training language models on CLEVRER's questions, and the judge as a reward for models that make videos.

`exact`, `per_option`, `answer_format` and `evidence` are called as TRL's `GRPOTrainer` does:

    >>> trainer = GRPOTrainer(model, reward_funcs=[exact, per_option, answer_format, evidence], ...)

They get the completions of a batch (texts, or lists of messages) and the columns of the data set as lists. The columns are
those of `nsdr export --format trl`: `solution` (`nsdr.clevrer.solution`), `options` (the texts of the question's options; empty
for an open question) and, for `evidence`, `program`, `option_programs` and `scene` (path of a file with the video's scene).
`verl`, `easyr1`, `SWIFT` and `video_r1` are the same rewards with the signatures of these frameworks. See `docs/rewards.md`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
