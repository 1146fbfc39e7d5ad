"""Questions beyond CLEVRER in the notation of `grammar.english`: speeds, directions, masses, and objects that are changed.

They are read by rules alone: the networks have not learnt them.
"""

import re

from nsdr.language.english import ENGLISH_RULES
from nsdr.language.rules import Rules

__all__ = ["EXTENDED", "EXTENSION_PHRASES", "EXTENSION_SYMBOLS"]

EXTENSION_SYMBOLS = {"descriptive": "BEYOND", "multiple_choice": "WHATIF"}
"""The symbol of each kind of text; choices are CLEVRER's own."""

_RULES = r"""
# A time at which something is measured: one frame.
AT: when video begin => start get_frame
AT: when video end => end get_frame
AT: when CLAUSE => CLAUSE get_frame

FASTER: (faster|quicker) => is_faster
GETFASTER: (faster|quicker) => get_faster
GETFASTER: slower => get_slower
GETHEAVIER: heavier => get_heavier
GETHEAVIER: lighter => get_lighter
FASTEST: (fastest|quickest) => filter_fastest
FASTEST: slowest => filter_slowest
HEAVIEST: heaviest => filter_heaviest
HEAVIEST: lightest => filter_lightest

BEYOND: how fast (be ONE [moving]|do ONE move) AT => ONE AT query_speed
BEYOND: what be [the] speed of ONE AT => ONE AT query_speed
BEYOND: what be ONE 's speed AT => ONE AT query_speed
BEYOND: what speed (do|have) ONE [have] AT => ONE AT query_speed
BEYOND: [in|into] what (direction|way) (do ONE move|be ONE [moving]) AT => ONE AT query_direction
BEYOND: where (do ONE move|be ONE moving) AT => ONE AT query_direction
BEYOND: what be [the] direction of ONE AT => ONE AT query_direction
BEYOND: (be ONE1 [moving]|do ONE1 move) FASTER than ONE2 AT => ONE1 ONE2 AT FASTER
BEYOND: (be ONE1 [moving]|do ONE1 move) slower than ONE2 AT => ONE2 ONE1 AT is_faster
BEYOND: be ONE1 heavier than ONE2 => ONE1 ONE2 is_heavier
BEYOND: be ONE1 lighter than ONE2 => ONE2 ONE1 is_heavier
BEYOND: do ONE1 weigh more than ONE2 => ONE1 ONE2 is_heavier
BEYOND: do ONE1 weigh less than ONE2 => ONE2 ONE1 is_heavier
BEYOND: what [OBJ] (be|move) [the] GETFASTER AT ONE1 or ONE2 => ONE1 ONE2 AT GETFASTER query_name
BEYOND: what [OBJ] (be|move) [the] GETFASTER ONE1 or ONE2 AT => ONE1 ONE2 AT GETFASTER query_name
BEYOND: what of ONE1 and ONE2 (be|move) [the] GETFASTER AT => ONE1 ONE2 AT GETFASTER query_name
BEYOND: what [OBJ] be [the] GETHEAVIER ONE1 or ONE2 => ONE1 ONE2 GETHEAVIER query_name
BEYOND: what of ONE1 and ONE2 be [the] GETHEAVIER => ONE1 ONE2 GETHEAVIER query_name
BEYOND: what CLASS (be|move) [the] FASTEST EVER => objects CLASS EVER FASTEST unique query_name
BEYOND: what be the FASTEST N EVER => objects N EVER FASTEST unique query_name
BEYOND: what CLASS be [the] HEAVIEST => objects CLASS HEAVIEST unique query_name
BEYOND: what be the HEAVIEST N => objects N HEAVIEST unique query_name
BEYOND: what be [the] ATTRIBUTE of SUPERLATIVE => SUPERLATIVE ATTRIBUTE
BEYOND: what ATTRIBUTE be SUPERLATIVE => SUPERLATIVE ATTRIBUTE
SUPERLATIVE: the FASTEST N EVER => objects N EVER FASTEST unique
SUPERLATIVE: the HEAVIEST N => objects N HEAVIEST unique
EVER: => null
EVER: AT => AT

# What would happen if one object were different.
WHATIF: what [will|do] happen IF CHANGED => all_events CHANGED get_changed belong_to
WHATIF: what (will not|do not|not) happen IF CHANGED => all_events CHANGED get_changed belong_to negate
WHATIF: what if CHANGED => all_events CHANGED get_changed belong_to
IF: (if|suppose|imagine|assume) [that] =>
CHANGED: ONE (be|move) CHANGE => ONE CHANGE
CHANGED: ONE (be stationary|stay stationary|not move|do not move) => ONE standing_still
CHANGE: twiceheavy => twice_as_heavy
CHANGE: halfheavy => half_as_heavy
CHANGE: twicefast => twice_as_fast
CHANGE: halffast => half_as_fast
"""

EXTENDED = Rules(ENGLISH_RULES + _RULES)
"""The rules of CLEVRER's texts and of those beyond."""
_TWICE, _HALF = r"(?:twice|double|two times|2 times)", r"(?:half|one half)"
EXTENSION_PHRASES = tuple(
    (re.compile(pattern, re.IGNORECASE), word)
    for factor, word_of_factor in ((_TWICE, "twice"), (_HALF, "half"))
    for pattern, word in (
        (rf"\b{factor} as (?:heavy|massive)(?: as (?:it (?:is|was)|now))?\b", f"{word_of_factor}heavy"),
        (rf"\b(?:weighed|weighs|weighing) {factor} as much\b", f"was {word_of_factor}heavy"),
        (rf"\b(?:had|has) {factor} (?:the|its) (?:mass|weight)\b", f"was {word_of_factor}heavy"),
        (rf"\b{factor} as (?:fast|quick)(?: as (?:it (?:is|was)|now))?\b", f"{word_of_factor}fast"),
        (rf"\b(?:had|has|at) {factor} (?:the|its) speed\b", f"was {word_of_factor}fast"),
    )
)
"""(pattern, replacement): what is read as one word, before a text is put into normal form."""
