from .paraphrase import draw_wording as draw_wording, read_paraphrases as read_paraphrases
from .templates import (
    TEXT_KINDS as TEXT_KINDS,
    Chooser as Chooser,
    Grammar as Grammar,
    Pair as Pair,
    Phrases as Phrases,
    described as described,
    every as every,
    sample as sample,
)
