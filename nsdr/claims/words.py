"""Clauses in normal form: noun phrases, frames and verbs as single tokens, which `nsdr.claims.reading` matches."""

import re
from dataclasses import dataclass

from nsdr.claims.statements import LAST_FRAME, ObjectPhrase
from nsdr.world.nouns import ADJECTIVES, NOUNS

__all__ = ["Clause", "normal_clause"]

NUMBERS = {
    "no": 0,
    "one": 1,
    "two": 2,
    "three": 3,
    "four": 4,
    "five": 5,
    "six": 6,
    "seven": 7,
    "eight": 8,
    "nine": 9,
    "ten": 10,
}
"""Number words."""
_ADJECTIVE = "|".join(ADJECTIVES)
_NOUN = "|".join(sorted(NOUNS, key=len, reverse=True))
_NUMBER = r"\d{1,3}|" + "|".join(NUMBERS)
_NOUN_PHRASE = re.compile(rf"(?:\b(the|this|that|an?|{_NUMBER}) )?((?:\b(?:{_ADJECTIVE})\b,? )*)\b({_NOUN})\b|\b(it)\b")
_FRAME = re.compile(r"\b(?:the )?frames? (?:#|number )?(\d{1,6})\b(?! ?[-\u2013.,/] ?\d)")
_COLLISIONS = re.compile(rf"\b({_NUMBER}) collisions?\b(?! (?:between|of|involving) (?:\w+ )+and )")

# (pattern, replacement), in this order, on a lower-case text; what is in capitals is a token of the normal form.
_VERBS = (
    (r"\bexactly (?=\d|[a-z])|\ba total of ", ""),
    (r"\bwhen the video (?:begins|starts)\b|\bat the (?:start|beginning) of the video\b", "at FIRST"),
    (r"\bwhen the video ends\b|\bat the end of the video\b", "at LAST"),
    (r"\bafter the (?:end of the )?video(?: ends| is over| has ended)?\b", "LATER"),
    (r"\b(?:in|during) the video\b", "INVIDEO"),
    (r"\b(?:will not|won't)\b", "WILL NOT"),
    (r"\b(?:would not|wouldn't)\b", "WOULD NOT"),
    (r"\b(?:would no longer)\b", "WOULD NOT"),
    (r"\bwill\b", "WILL"),
    (r"\bwould\b", "WOULD"),
    (r"\b(?:WILL|WOULD)(?: NOT)? have\b", lambda m: m[0].removesuffix(" have")),
    (r"\b(?:is|are|was|were) not\b|\b(?:is|are|was|were)n't\b", "IS NOT"),
    (r"\b(?:is|are|was|were)\b", "IS"),
    (r"\b(?:do|does|did) not\b|\b(?:do|does|did)n't\b", "NOT"),
    (r"\bnever\b", "NEVER"),
    (r"\b(?:IS )(?:hit|struck) by\b", "HIT"),
    (r"\bhits? (?:each other|one another)\b|\bcollided?s? (?:with each other|with one another|together)\b", "COLLIDE"),
    (r"\b(?:IS )?(?:colliding|collides?|collided) (?:with|into)\b", "HIT"),
    (r"\b(?:IS )?hitting\b|\bhits?\b|\bstrikes?\b|\bstruck\b", "HIT"),
    (r"\b(?:bumps?|bumped|crash|crashes|crashed|runs?) into\b", "HIT"),
    (r"\b(?:IS )?colliding\b|\bcollides?\b|\bcollided\b", "COLLIDE"),
    (r"\b(?:IS )?entering\b|\benters?\b|\bentered\b", "ENTER"),
    (r"\b(?:IS )?(?:exiting|leaving)\b|\bexits?\b|\bexited\b|\bleaves?\b|\bleft\b", "EXIT"),
    (r"\b(ENTER|EXIT) (?:into |from )?the (?:scene|video|view|image)\b", r"\1"),
    (r"\b(?:entrance|entry)\b", "ENTRANCE"),
    (r"\b(?:collision)s?\b", "COLLISION"),
    (r"\b(?:happens?|happened|occurs?|occurred|takes? place|took place)\b", "HAPPEN"),
    (r"\bmoving\b|\bin motion\b", "MOVING"),
    (r"\bmoves?\b|\bmoved\b", "MOVE"),
    (r"\bstationary\b|\bat rest\b|\bmotionless\b", "STATIONARY"),
    (r"\bIS (?:caused by|(?:the|a) result of)\b", "BY"),
    (r"\bIS NOT (?:caused by|(?:the|a) result of)\b", "NOT BY"),
    (r"\b(IS|IS NOT) responsible for\b", lambda m: "NOT LED" if m[1] == "IS NOT" else "LED"),
    (r"\b(?:leads?|led) to\b|\bcauses?\b|\bcaused\b|\bresult(?:s|ed)? in\b", "LED"),
    (r"\b(?:the )?presence of (?=[NA]\d)", ""),
    (r"\b([NA]\d+)'s presence\b", r"\1"),
    (r"\b([NA]\d+) (?:then|also|finally|eventually|subsequently) ", r"\1 "),
    (r" ?,? (?:so|therefore|thus|hence) the answer (?:IS|must be|should be) [\w, ]+$", ""),
)  # fmt: skip
VERBS = tuple((re.compile(pattern), replacement) for pattern, replacement in _VERBS)


@dataclass(frozen=True)
class Clause:
    """A clause in normal form.

    Attributes:
        text: tokens; `N0` stands for "the cube", `A0` for "a cube", `K0` for "2 cubes", `P0` for "cubes", `C0` for "2
            collisions" and `F0` for a frame.
        phrases: noun phrases by token.
        numbers: counts by token (`K` and `C`) and frames by token (`F`).
    """

    text: str
    phrases: dict[str, ObjectPhrase]
    numbers: dict[str, int]


def normal_clause(text: str) -> Clause:
    """A sentence or clause in normal form."""
    phrases: dict[str, ObjectPhrase] = {}
    numbers: dict[str, int] = {}

    def frame(match: re.Match[str]) -> str:
        numbers[f"F{len(numbers)}"] = int(match[1])
        return f"F{len(numbers) - 1}"

    def collisions(match: re.Match[str]) -> str:
        numbers[f"C{len(numbers)}"] = _number(match[1])
        return f"C{len(numbers) - 1}"

    def noun_phrase(match: re.Match[str]) -> str:
        article, adjectives, noun, pronoun = match.groups()
        if pronoun:
            token, phrase = f"N{len(phrases)}", ObjectPhrase(pronoun, (), known=False)
        else:
            shape, form = NOUNS[noun]
            words = (*(ADJECTIVES[w] for w in re.findall(r"\w+", adjectives)), *((shape,) if shape else ()))
            counted = article is not None and (article in NUMBERS or article.isdigit())
            kind = "K" if counted else "P" if form == "NS" else "A" if article in ("a", "an") else "N"
            token, phrase = f"{kind}{len(phrases)}", ObjectPhrase(match[0], words, definite=kind == "N")
            if counted:
                numbers[token] = _number(article)
        phrases[token] = phrase
        return token

    text = re.sub(r"\s+", " ", text.lower().replace("\u2019", "'")).strip()
    text = _FRAME.sub(frame, text)
    text = re.sub(r"\((?:at )?(F\d+)\)", r"at \1", text)
    text = _COLLISIONS.sub(collisions, text)
    text = _NOUN_PHRASE.sub(noun_phrase, text)
    for pattern, replacement in VERBS:
        text = pattern.sub(replacement, text)
    for token, value in (("FIRST", 0), ("LAST", LAST_FRAME)):
        if token in text:
            numbers[f"F{len(numbers)}"] = value
            text = text.replace(token, f"F{len(numbers) - 1}")
    text = re.sub(r"\b(?:at )?(?:in|around|about|near|during|approximately) (?=F\d)", "at ", text)
    return Clause(re.sub(r" ?([,:]) ?", r" \1 ", text).strip(), phrases, numbers)


def _number(word: str) -> int:
    return int(word) if word.isdigit() else NUMBERS[word]
