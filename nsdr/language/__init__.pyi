from .normal import Normal as Normal, normal_form as normal_form
from .rules import (
    Chooser as Chooser,
    Pair as Pair,
    Phrases as Phrases,
    Rules as Rules,
    load_rules as load_rules,
)
from .slots import Slot as Slot
from .texts import (
    TEXT_KINDS as TEXT_KINDS,
    clevrer as clevrer,
    draw_wording as draw_wording,
    english as english,
    in_words as in_words,
    read_paraphrases as read_paraphrases,
    sample as sample,
)
