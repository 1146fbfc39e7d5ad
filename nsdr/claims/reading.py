"""Reads the statements of a sentence, and writes them, with the rules of `nsdr.claims.grammar`.

A sentence is read as a whole or not at all: every word of it must be accounted for. So a hedge, a relative clause or a
condition that the grammar does not know makes the sentence unread, and never a claim that it does not make.
"""

import re
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from nsdr.claims.grammar import GRAMMAR, NORMAL
from nsdr.claims.statements import PAST_KINDS, PLACES, EventPhrase, ObjectPhrase, Statement
from nsdr.language.slots import Slot
from nsdr.symbolic.phrases import indefinite
from nsdr.world.nouns import ADJECTIVES, NOUNS
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["STATES", "read_sentence", "written"]

NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
"""Number words, in order."""
ORDERS = {"earlier": "before", "afterwards": "after"}
STATES = {"moving": "moving", "stationary": "stationary", "ever": "ever moving", "never": "never moving"}
_ADJECTIVE = "|".join(ADJECTIVES)
_NUMBER = r"\d{1,3}|" + "|".join(NUMBERS)
_TOKEN = re.compile(
    r"\b(?:the )?frames? (?:#|number )?(?P<frame>\d{1,6})\b(?! ?[-\u2013.,/] ?\d)|"
    rf"\b(?P<thing>(?:(?P<article>the|this|that|an?|{_NUMBER}) )?(?P<words>(?:(?:{_ADJECTIVE}),? )*)"
    rf"(?P<noun>{'|'.join(NOUNS)}))\b|\b(?P<it>it)\b|"
    rf"\b(?P<number>{_NUMBER.replace('no|', '')})(?= collisions?\b)|\b(?P<adjective>{_ADJECTIVE})\b|(?P<word>'s\b|\w+|\S)"
)
_ANSWER = r" ?,? (?:so|therefore|thus|hence) the answer (?:is|must be|should be) [\w, ]+$"
_PASSED_OVER = re.compile(rf"\bexactly |\ba total of |{_ANSWER}")


@dataclass(frozen=True)
class _Slot:
    """What a noun phrase, adjective, frame or number of a sentence stands for.

    Attributes:
        form: the word that stands for it in `GRAMMAR`.
        text: as it is written.
        phrase: of objects; an adjective is one without a noun.
        number: of a count, or a frame.
    """

    form: str
    text: str
    phrase: ObjectPhrase | None = None
    number: int | None = None


@lru_cache(maxsize=1 << 12)
def read_sentence(text: str, last_frame: int) -> tuple[Statement, ...]:
    """The statements of a sentence or clause; empty if any part of it is not read.

    Args:
        text: the sentence, without the stop at its end.
        last_frame: frame of "when the video ends".
    """
    words, slots = _tokens(text)
    slots |= {
        "zero": _Slot("Q", "", number=0),
        "first": _Slot("F", "", number=0),
        "last": _Slot("F", "", number=last_frame),
    }
    if not GRAMMAR.words.issuperset(w for w in words if not w.isupper()):
        return ()
    for line in GRAMMAR.readings("SENTENCE", words):
        if statements := _statements(line, slots):
            return statements
    return ()


def _tokens(text: str) -> tuple[tuple[str, ...], dict[str, _Slot]]:
    """The words of a text in normal form, with the forms of slots, and the slots by "#" and the index of their word."""
    words: list[str] = []
    slots: dict[str, _Slot] = {}
    text = re.sub(r"\s+", " ", text.lower().replace("\u2019", "'").replace("n't", " not").replace("wo not", "will not"))
    text = re.sub(r"\((?:at )?(?=(?:the )?frame [^()]*\))([^()]*)\)", r"at \1", text)
    for found in _TOKEN.finditer(_PASSED_OVER.sub("", text)):
        if word := found["word"]:
            words += NORMAL.get(word, word).split()
            continue
        slots[f"#{len(words)}"] = slot = _slot(found)
        words.append(slot.form)
    return tuple(words), slots


def _slot(found: re.Match[str]) -> _Slot:
    if found["frame"]:
        return _Slot("F", found[0], number=int(found["frame"]))
    if number := found["number"]:
        return _Slot("Q" if _number(number) == 1 else "QS", number, number=_number(number))
    if word := found["adjective"]:
        return _Slot("W", word, ObjectPhrase(word, (ADJECTIVES[word],)))
    if found["it"]:
        return _Slot("N", "it", ObjectPhrase("it", (), known=False))
    shape, form = NOUNS[found["noun"]]
    words = (*(ADJECTIVES[w] for w in re.findall(r"\w+", found["words"])), *((shape,) if shape else ()))
    article = found["article"] or ""
    if article in NUMBERS or article.isdigit():
        number = _number(article)
        return _Slot("K" if number < 2 else "KS", found[0], ObjectPhrase(found[0], words, False), number)
    form = form if form == "NS" else "A" if article in ("a", "an") else "N"
    return _Slot(form, found[0], ObjectPhrase(found[0], words, form == "N"))


def _number(word: str) -> int:
    return int(word) if word.isdigit() else NUMBERS.index(word)


def _statements(line: tuple[str, ...], slots: dict[str, _Slot]) -> tuple[Statement, ...]:
    """The statements of the clauses of a line; empty if they don't fit together."""
    *shared, clauses = "\n".join(line).replace("\n|\n", "|").split("|")
    context = [token for part in shared for token in part.split("\n")]
    statements: list[Statement] = []
    subject = ""
    for clause in clauses.split("\n;\n"):
        tokens = clause.split("\n")
        if tokens[0] == "same":
            if slots[subject].form != "N" or statements[-1].negated:
                return ()
            tokens[0] = subject
        subject = tokens[0]
        statement = _statement([*context, *tokens], slots)
        if statement is None:
            return ()
        statements.append(statement)
    return tuple(statements)


def _statement(tokens: list[str], slots: dict[str, _Slot]) -> Statement | None:
    """The statement of a clause; None if it says something twice, or what does not go with its kind."""
    pending: list[_Slot] = []
    events: list[EventPhrase] = []
    said: list[tuple[str, Any]] = []

    def phrases() -> tuple[ObjectPhrase, ...]:
        found = tuple(slot.phrase for slot in pending if slot.phrase)
        pending.clear()
        return found

    for token in tokens:
        if token in slots:
            pending.append(slots[token])
        elif token in PAST_KINDS:
            events.append(EventPhrase(token, phrases()))
        elif token == "at" and events and events[-1].frame is None:
            events[-1] = replace(events[-1], frame=pending.pop().number)
        elif token in ("at", "number"):
            said.append(("frame" if token == "at" else "number", pending.pop().number))
        elif token in ("before", "after"):
            said += [("relation", token), ("frame", pending.pop().number)]
        elif token == "who":
            said += [("number", slot.number) for slot in pending if slot.number is not None]
            said.append(("objects", phrases()))
        elif token == "without":
            said.append(("removed", phrases()[0]))
        elif token == "attribute":
            words = tuple(word for phrase in phrases() for word in phrase.words)
            said += [("kind", token), ("words", words)]
        elif token in ORDERS:
            said += [("kind", "order"), ("relation", ORDERS[token])]
        elif token.startswith("nth-"):
            said += [("kind", "order"), ("number", PLACES[token.removeprefix("nth-")])]
        elif token in STATES:
            said.append(("words", (STATES[token],)))
        elif token in ATTRIBUTES:
            said.append(("attribute", token))
        elif token in ("not", "modal", "later"):
            said.append(({"not": "negated"}.get(token, token), True))
        elif token != "whole":
            said.append(("kind", token))
    fields = dict(said)
    modal, later = fields.pop("modal", False), fields.pop("later", False)
    if len(dict(said)) < len(said) or (modal and not (later or "removed" in fields)):
        return None
    return _complete(Statement(**{"kind": "event", **fields}, events=tuple(events)), later)


def _complete(said: Statement, later: bool) -> Statement | None:
    """The statement with its kind and frame in place; None if it says what does not go with its kind."""
    event = said.events[0] if said.events else None
    world = "future" if later else "counterfactual" if said.removed else ""
    if later and said.removed:
        return None
    if said.kind == "event":
        assert event is not None
        if said.relation or said.frame is None:
            valid = not said.relation or (event.frame is None and not world)
            return replace(said, kind=world or PAST_KINDS[event.kind]) if valid else None
        event = replace(event, frame=said.frame) if event.frame is None else None
        return replace(said, kind=world or PAST_KINDS[event.kind], frame=None, events=(event,)) if event else None
    if said.kind == "count" and event:
        said = replace(said, kind="future") if later and event.kind == "collision" and not said.relation else said
        valid = (
            event.frame is None and (said.frame is None or bool(said.relation)) and (not world or said.kind == world)
        )
    elif said.kind in ("motion", "count"):
        if said.frame is not None and said.words == (STATES["ever"],):
            said = replace(said, words=("moving",))
        over_video = said.words[0] not in STATES
        valid = not world and ((said.kind == "motion" and said.frame is None) or over_video == (said.frame is None))
    else:
        valid = not world and said.frame is None
        if said.attribute:
            valid &= len(said.words) == 1 and said.words[0] in ATTRIBUTES[said.attribute]
    return said if valid else None


def written(statement: Statement) -> str:
    """The sentence that tells a statement; `read_sentence` reads it back."""
    slots: list[_Slot] = []
    line = _line(statement, slots)
    words = GRAMMAR.write("SENTENCE", line, [(slot.form,) for slot in slots])
    assert words is not None, f"{statement} has no sentence"
    text = " ".join(word if isinstance(word, str) else slots[word[1]].text for word in words)
    return re.sub(r" (?=[,:'])", "", f"{text[0].upper()}{text[1:]}.")


def _line(said: Statement, slots: list[_Slot]) -> list[str]:
    """The line of tokens of a statement, whose slots are appended to `slots`."""

    def slot(form: str, text: str) -> str:
        slots.append(_Slot(form, text))
        return f"#{len(slots) - 1}"

    def things(*phrases: ObjectPhrase) -> list[str]:
        return [slot("N" if p.definite else "A", p.text) for p in phrases]

    def at(frame: int | None, *end: str) -> list[str]:
        return [] if frame is None else [slot("F", f"frame {frame}"), *end]

    events, frame = said.events, said.frame
    if said.kind in (*PAST_KINDS.values(), "future", "counterfactual") and not said.relation:
        frame = events[0].frame
        events = (replace(events[0], frame=None),)
    line = [*things(said.removed), "without", "|"] if said.removed else []
    line += ["later", "|"] if said.kind == "future" else []
    line += at(frame, "at", "|") if not said.relation else []
    number = said.number if said.kind != "order" else None
    many = number is not None and number > 1
    if number is None or not said.objects:
        line += [*things(*said.objects), "who"] if said.objects else []
        line += [] if number is None else [slot("QS" if many else "Q", str(number)) if number else "zero", "number"]
    else:
        text = f"{number or 'no'} {Slot('NS' if many else 'N', said.objects[0].words).text}"
        line += [slot("KS" if many else "K", text), "who"]
    for event in events:
        line += [*things(*event.objects), event.kind, *at(event.frame, "at")]
    if said.kind == "attribute":
        noun = said.words[-1] in ATTRIBUTES["shape"] and not said.attribute
        line += [slot("A", indefinite(Slot("N", said.words).text))] if noun else [slot("W", w) for w in said.words]
    if said.kind == "order":
        line += [f"nth-{place}" for place, number in PLACES.items() if number == said.number]
        line += [token for token, relation in ORDERS.items() if relation == said.relation]
    elif said.kind in ("attribute", "presence", "motion", "count", "cause"):
        line.append(said.kind)
    elif number is not None:
        line.append("count")  # of collisions after the video
    line += [token for token, state in STATES.items() if said.words == (state,)]
    line += [said.attribute] * bool(said.attribute) + ["not"] * said.negated
    line += ["modal"] if said.removed else ["whole"] if said.kind == "count" and events and not said.relation else []
    return line + (at(said.frame, said.relation) if said.relation and said.frame is not None else [])
