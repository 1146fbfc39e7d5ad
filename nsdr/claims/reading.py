"""Reads the statements of one sentence (the grammar of claims, `docs/rewards.md`).

A sentence is read as a whole or not at all: every word of it must be accounted for. So a hedge, a relative clause or a
condition that the grammar does not know makes the sentence unread, and never a claim that it does not make.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

from nsdr.claims.statements import PAST_KINDS, EventPhrase, ObjectPhrase, Statement
from nsdr.claims.words import Clause, normal_clause
from nsdr.world.nouns import ADJECTIVES
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["read_sentence"]

O = r"([NA]\d+)"  # noqa: E741
W = rf"(?:{'|'.join(ADJECTIVES)})"
MODAL = r"(?:(?:WILL|WOULD) )?"
PLACES = {"first": 1, "second": 2, "last": -1}
CONNECTIVES = re.compile(
    r"^(?:(?:so|then|finally|also|therefore|thus|hence|and|but|now|meanwhile|later|here|however|first|firstly|afterwards|"
    r"as a result|in fact|INVIDEO)\b ?,? ?)+"
)
SEPARATORS = re.compile(r" , and then | , and | , then | , but | , while | , | ; | and then | and ")
ATTRIBUTE = rf"({'|'.join((*ATTRIBUTES, 'colour'))})"


@dataclass(frozen=True)
class _Context:
    """What a sentence says about when and in which course of events it holds."""

    frame: int | None = None
    later: bool = False
    removed: ObjectPhrase | None = None


_PREFIXES = (
    (re.compile(r"^(?:at )?(F\d+) [:,] (.+)$"), "frame"),
    (re.compile(r"^(?:at )(F\d+) (.+)$"), "frame"),
    (re.compile(r"^(LATER) (?:[:,] )?(.+)$"), "later"),
    (re.compile(rf"^without {O} (?:[:,] )?(.+)$"), "removed"),
    (
        re.compile(rf"^if {O} (?:IS (?:removed|absent|gone|taken away)|IS NOT (?:there|present)) (?:, )?(.+)$"),
        "removed",
    ),
    (re.compile(rf"^(?:removing {O}|if (?:we|you) removed? {O}) (?:, )?(.+)$"), "removed"),
)
_SUFFIXES = (
    (re.compile(r"^(.+) at (F\d+)$"), "frame"),
    (re.compile(r"^(.+?)(?: ,)? (LATER)$"), "later"),
    (re.compile(rf"^(.+?)(?: ,)? without {O}$"), "removed"),
    (
        re.compile(rf"^(.+?)(?: ,)? if {O} (?:IS (?:removed|absent|gone|taken away)|IS NOT (?:there|present))$"),
        "removed",
    ),
)


@lru_cache(maxsize=1 << 12)
def read_sentence(text: str) -> tuple[Statement, ...]:
    """The statements of a sentence or clause; empty if any part of it is not read."""
    clause = normal_clause(text)
    words = CONNECTIVES.sub("", clause.text)
    context, words = _with_prefixes(clause, words)
    return tuple(_clauses(clause, words, context) or ())


def _with_prefixes(clause: Clause, words: str) -> tuple[_Context, str]:
    context = _Context()
    for _ in _PREFIXES:
        for pattern, name in _PREFIXES:
            match = pattern.match(words)
            if match:
                token, words = [g for g in match.groups() if g is not None]
                context = _added(clause, context, name, token)
                break
        else:
            break
    return context, words


def _added(clause: Clause, context: _Context, name: str, token: str) -> _Context:
    if name == "later":
        return replace(context, later=True)
    if name == "removed":
        return replace(context, removed=clause.phrases[token])
    return replace(context, frame=clause.numbers[token])


def _clauses(clause: Clause, words: str, context: _Context) -> list[Statement] | None:
    """Statements of clauses in a row; a later clause may leave out the subject of the first."""
    whole = _one(clause, words, context)
    if whole:
        return [whole]
    for separator in SEPARATORS.finditer(words):
        left, right = words[: separator.start()], words[separator.end() :]
        first = _one(clause, left, context)
        if first is None:
            continue
        right = CONNECTIVES.sub("", right)
        rest = _clauses(clause, right, context)
        subject = re.match(r"(N\d+) (?!and)", left)
        if rest is None and subject and not first.negated:
            rest = _clauses(clause, f"{subject[1]} {right}", context)
        if rest and len({(s.removed, s.kind == "future") for s in (first, *rest)}) == 1:
            return [first, *rest]
    return None


def _one(clause: Clause, words: str, context: _Context) -> Statement | None:
    for pattern, name in _SUFFIXES:
        match = pattern.match(words)
        if match and not _knows(context, name):
            found = _one(clause, match[1], _added(clause, context, name, match[2]))
            if found:
                return found
    modal = re.search(r"\b(?:WILL|WOULD)\b", words)
    allowed = ("WILL", "WOULD") if context.removed else ("WILL",) if context.later else ()
    if (modal and modal[0] not in allowed) or (context.later and context.removed):
        return None
    for read in _READERS:
        found = read(clause, words, context)
        if found:
            return found
    return None


def _knows(context: _Context, name: str) -> bool:
    return context.later if name == "later" else getattr(context, name) is not None


def _event_noun(clause: Clause, words: str) -> EventPhrase | None:
    """ "the collision of N0 and N1", "N0's exit", perhaps with "at F0"."""
    words, frame = _with_frame(clause, words)
    patterns: tuple[tuple[str, Callable[[re.Match[str]], tuple[str, tuple[str, ...]]]], ...] = (
        (rf"(?:the |a )?COLLISION (?:between|of|involving) {O} (?:and|with) {O}", lambda m: ("collision", m.groups())),
        (rf"{O}'s COLLISION with {O}", lambda m: ("collision", m.groups())),
        (rf"(?:the )?(ENTRANCE|EXIT) of {O}", lambda m: (m[1], (m[2],))),
        (rf"{O}'s (ENTRANCE|EXIT)", lambda m: (m[2], (m[1],))),
    )
    for pattern, parts in patterns:
        match = re.fullmatch(pattern, words)
        if match:
            verb, objects = parts(match)
            kind = {"ENTRANCE": "in", "EXIT": "out"}.get(verb, verb)
            return EventPhrase(kind, tuple(clause.phrases[o] for o in objects), frame)
    return None


def _with_frame(clause: Clause, words: str) -> tuple[str, int | None]:
    match = re.fullmatch(r"(.+) at (F\d+)", words)
    return (match[1], clause.numbers[match[2]]) if match else (words, None)


def _event_clause(clause: Clause, words: str) -> tuple[EventPhrase, bool] | None:
    """ "N0 and N1 COLLIDE", "N0 NOT EXIT", "the collision of N0 and N1 HAPPEN", and whether it is denied."""
    words, frame = _with_frame(clause, words)
    match = re.fullmatch(rf"{O} and {O} {MODAL}(NOT |NEVER )?COLLIDE", words)
    if match:
        return EventPhrase("collision", (clause.phrases[match[1]], clause.phrases[match[2]]), frame), bool(match[3])
    match = re.fullmatch(rf"{O} {MODAL}(NOT |NEVER )?HIT {O}", words)
    if match:
        return EventPhrase("collision", (clause.phrases[match[1]], clause.phrases[match[3]]), frame), bool(match[2])
    match = re.fullmatch(rf"{O} {MODAL}(NOT |NEVER )?(ENTER|EXIT)", words)
    if match:
        kind = "in" if match[3] == "ENTER" else "out"
        return EventPhrase(kind, (clause.phrases[match[1]],), frame), bool(match[2])
    match = re.fullmatch(rf"there IS (a |no |NOT a )?(COLLISION (?:between|of|involving) {O} and {O})", words)
    if match:
        noun = _event_noun(clause, match[2])
        return (replace(noun, frame=frame), match[1] in ("no ", "NOT a ")) if noun else None
    match = re.fullmatch(rf"(.+?) {MODAL}(NOT |NEVER )?HAPPEN", words)
    noun = _event_noun(clause, match[1]) if match else None
    if match is None or noun is None or None not in (noun.frame, frame):
        return None
    return (noun if frame is None else replace(noun, frame=frame)), bool(match[2])


def _event(clause: Clause, words: str, context: _Context) -> Statement | None:
    match = re.fullmatch(r"(.+) (before|after) (F\d+)", words)
    relation, frame = "", context.frame
    if match and context.frame is None:
        words, relation, frame = match[1], match[2], clause.numbers[match[3]]
    found = _event_clause(clause, words.removesuffix(" INVIDEO"))
    if found is None and context.frame is not None:
        noun = _event_noun(clause, words)
        found = (noun, False) if noun else None
    if found is None:
        return None
    event, negated = found
    kind = "counterfactual" if context.removed else "future" if context.later else PAST_KINDS[event.kind]
    if relation and (event.frame is not None or kind != PAST_KINDS[event.kind]):
        return None
    if not relation and frame is not None:
        if event.frame is not None:
            return None
        event, frame = replace(event, frame=frame), None
    return Statement(kind, negated, events=(event,), frame=frame, relation=relation, removed=context.removed)


def _order(clause: Clause, words: str, context: _Context) -> Statement | None:
    """One event before or after another, or the place of an object or collision in a row of events."""
    if context != _Context():
        return None
    match = re.fullmatch(r"(before|after) (.+) , (.+)", words)
    if match:
        left, relation, right = match[3], match[1], match[2]
    elif len(re.findall(r" (?:before|after) ", words)) == 1:
        left, relation, right = re.split(r" (before|after) ", words)
    else:
        return _place(clause, words)
    first = _plain_event(clause, left)
    second = _plain_event(clause, right)
    return Statement("order", events=(first, second), relation=relation) if first and second else None


def _plain_event(clause: Clause, words: str) -> EventPhrase | None:
    """An event as a noun or as a clause that does not deny it."""
    noun = _event_noun(clause, re.sub(r" (?:HAPPEN|IS)$", "", words))
    if noun:
        return noun
    found = _event_clause(clause, words)
    return found[0] if found and not found[1] else None


def _place(clause: Clause, words: str) -> Statement | None:
    match = re.fullmatch(
        rf"the (first|second|last) COLLISION IS (?:the )?(?:COLLISION )?(?:between|of) {O} and {O}", words
    )
    if match:
        event = EventPhrase("collision", (clause.phrases[match[2]], clause.phrases[match[3]]))
        return Statement("order", events=(event,), number=PLACES[match[1]])
    match = re.fullmatch(rf"the (first|second|last) (N\d+) (?:to|that) (ENTER|EXIT|HIT {O}) IS {O}", words)
    if not match:
        return None
    place, members, verb, partner, filler = match.groups()
    kind = {"ENTER": "in", "EXIT": "out"}.get(verb, "collision")
    event = EventPhrase(kind, (clause.phrases[partner],) if partner else ())
    objects = (clause.phrases[members], clause.phrases[filler])
    return Statement("order", objects=objects, events=(event,), number=PLACES[place])


def _cause(clause: Clause, words: str, context: _Context) -> Statement | None:
    if context != _Context():
        return None
    match = re.fullmatch(r"(.+?) (NOT |NEVER )?(LED|BY) (.+)", words)
    if match:
        left, denied, verb, right = match.groups()
        cause, effect = (left, right) if verb == "LED" else (right, left)
    else:
        match = re.fullmatch(r"(.+) because(?: of)? (.+)", words)
        if not match:
            return None
        effect, denied, cause = match[1], None, match[2]
    second = _plain_event(clause, effect)
    if second is None:
        return None
    if re.fullmatch(O, cause):
        return Statement("cause", bool(denied), (clause.phrases[cause],), (second,))
    first = _plain_event(clause, cause)
    return Statement("cause", bool(denied), events=(first, second)) if first else None


def _motion(clause: Clause, words: str, context: _Context) -> Statement | None:
    """Of one object or of a number of them, at a frame or over the video."""
    if context.later or context.removed:
        return None
    match = re.fullmatch(r"([NK]\d+) IS (NOT )?(MOVING|STATIONARY)", words)
    if match:
        state = match[3].lower()
        if match[2]:
            state = "stationary" if state == "moving" else "moving"
    else:
        match = re.fullmatch(r"([NK]\d+) (NEVER )?MOVE(?: INVIDEO)?", words)
        if not match or (context.frame is not None and match[2]):
            return None
        state = "never moving" if match[2] else "moving" if context.frame is not None else "ever moving"
    token = match[1]
    if token[0] == "N":
        return Statement("motion", objects=(clause.phrases[token],), words=(state,), frame=context.frame)
    if context.frame is None and state in ("moving", "stationary"):
        return None
    number = clause.numbers[token]
    return Statement("count", False, (clause.phrases[token],), words=(state,), number=number, frame=context.frame)


def _count(clause: Clause, words: str, context: _Context) -> Statement | None:
    if context.removed or context.frame is not None:
        return None
    match = re.fullmatch(r"there IS (?:NOT )?([KA]\d+)(?: INVIDEO)?", words)
    if match and not context.later:
        phrase = clause.phrases[match[1]]
        if match[1][0] == "A":
            return Statement("presence", " NOT " in words, (phrase,))
        return None if " NOT " in words else Statement("presence", objects=(phrase,), number=clause.numbers[match[1]])
    relation, frame = "", None
    match = re.fullmatch(r"(.+) (before|after) (F\d+)", words)
    if match and not context.later:
        words, relation, frame = match[1], match[2], clause.numbers[match[3]]
    words = words.removesuffix(" INVIDEO")
    match = re.fullmatch(r"(K\d+) (ENTER|EXIT)", words)
    if match and not context.later:
        event = EventPhrase("in" if match[2] == "ENTER" else "out", ())
        phrase, number = clause.phrases[match[1]], clause.numbers[match[1]]
        return Statement("count", False, (phrase,), (event,), number=number, frame=frame, relation=relation)
    match = re.fullmatch(rf"(C\d+)(?: of {O})? HAPPEN|there IS (C\d+)(?: of {O})?", words)
    if not match:
        return None
    token, who = match[1] or match[3], match[2] or match[4]
    event = EventPhrase("collision", (clause.phrases[who],) if who else ())
    kind = "future" if context.later else "count"
    return Statement(kind, events=(event,), number=clause.numbers[token], frame=frame, relation=relation)


def _attribute(clause: Clause, words: str, context: _Context) -> Statement | None:
    if context != _Context():
        return None
    match = re.fullmatch(rf"the {ATTRIBUTE} of {O} IS (NOT )?({W}|[NA]\d+)", words) or re.fullmatch(
        rf"{O}'s {ATTRIBUTE} IS (NOT )?({W}|[NA]\d+)", words
    )
    if match:
        name, token = (match[1], match[2]) if match[1] in (*ATTRIBUTES, "colour") else (match[2], match[1])
        name = "color" if name == "colour" else name
        stated = _stated_words(clause, match[4])
        if len(stated) != 1 or stated[0] not in ATTRIBUTES[name]:
            return None
        return Statement("attribute", bool(match[3]), (clause.phrases[token],), words=stated, attribute=name)
    match = re.fullmatch(rf"{O} IS (NOT )?(?:made of )?({W}(?: (?:, |and )*{W})*|A\d+)", words)
    if not match:
        return None
    stated = _stated_words(clause, match[3])
    return Statement("attribute", bool(match[2]), (clause.phrases[match[1]],), words=stated) if stated else None


def _stated_words(clause: Clause, words: str) -> tuple[str, ...]:
    if words in clause.phrases:
        return clause.phrases[words].words
    return tuple(ADJECTIVES[w] for w in re.findall(W, words))


_READERS = (_event, _order, _cause, _motion, _count, _attribute)
