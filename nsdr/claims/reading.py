"""Reads the statements of a sentence, and writes them, with the rules in `claims.rules`.

A sentence is read as a whole or not at all: every word of it must be accounted for. So a hedge, a relative clause or a
condition that the grammar does not know makes the sentence unread, and never a claim that it does not make.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

from nsdr.claims.statements import HAPPENING, PAST_KINDS, EventPhrase, ObjectPhrase, Statement
from nsdr.language.normal import FORMS
from nsdr.language.rules import Rules
from nsdr.world.vocabulary import Vocabulary, indefinite

NORMAL = {
    **FORMS,
    **{"bumps": "bump", "bumped": "bump", "runs": "run", "ran": "run", "leads": "lead", "led": "lead"},
    **{"results": "result", "resulted": "result", "leaves": "leave", "left": "leave"},
    **{"took": "take", "takes": "take", "entry": "entrance", "removed": "remove"},
}
"""Word -> its normal form."""
SLOTS = {"OBJ": ("N", "A"), **{form: (form,) for form in ("N", "A", "K", "KS", "Q", "QS", "F", "W")}}
GRAMMAR = Rules(files("nsdr.claims").joinpath("claims.rules").read_text("utf-8"), SLOTS, NORMAL)
NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
"""Number words, in order."""
STATES = ("moving", "stationary")
"""States of motion at a frame; "ever moving" and "never moving" are those of the whole video."""
_VALUES: dict[str, Callable[[str], Any]] = {
    "number": int,
    "words": lambda value: (value.replace("-", " "),),
    "negated": bool,
}
"""What makes the value of a field from a line's text; others are texts."""
_NUMBER = r"\d{1,3}|" + "|".join(NUMBERS)


@cache
def _token(vocabulary: Vocabulary) -> re.Pattern[str]:
    adjective = "|".join(vocabulary.adjectives)
    return re.compile(
        r"\b(?:the )?frames? (?:#|number )?(?P<frame>\d{1,6})\b(?! ?[-\u2013.,/] ?\d)|"
        r"(?<![\w.,:/\u2013-])(?<!during )(?P<seconds>\d{1,4}(?:\.\d{1,4})?) ?(?:s|sec|seconds?)\b|"
        rf"\b(?P<thing>(?:(?P<article>the|this|that|an?|{_NUMBER}) )?(?P<words>(?:(?:{adjective}),? )*)"
        rf"(?P<noun>{'|'.join(vocabulary.nouns)}))\b|\b(?P<it>it)\b|"
        rf"\b(?P<number>{_NUMBER.replace('no|', '')})(?= collisions?\b)|\b(?P<adjective>{adjective})\b|(?P<word>'s\b|\w+|\S)"
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
def read_sentence(text: str, last_frame: int, vocabulary: Vocabulary, fps: float) -> tuple[Statement, ...]:
    """The statements of a sentence or clause; empty if any part of it is not read.

    Args:
        text: the sentence, without the stop at its end.
        last_frame: frame of "when the video ends".
        vocabulary: of the words of objects.
        fps: frames per second, for times.
    """
    words, slots = _tokens(text, vocabulary, fps)
    slots |= {
        "first": _Slot("F", "", number=0),
        "last": _Slot("F", "", number=last_frame),
    }
    if not GRAMMAR.words.issuperset(w for w in words if not w.isupper()):
        return ()
    for line in GRAMMAR.readings("SENTENCE", words):
        if statements := _statements(line, slots, vocabulary):
            return statements
    return ()


def _tokens(text: str, vocabulary: Vocabulary, fps: float) -> tuple[tuple[str, ...], dict[str, _Slot]]:
    """The words of a text in normal form, with the forms of slots, and the slots by "#" and the index of their word."""
    words: list[str] = []
    slots: dict[str, _Slot] = {}
    text = re.sub(r"\s+", " ", text.lower().replace("\u2019", "'").replace("n't", " not").replace("wo not", "will not"))
    text = re.sub(r"\((?:at )?(?=(?:the )?frame [^()]*\)|[\d.]+ ?s[a-z]*\))([^()]*)\)", r"at \1", text)
    for found in _token(vocabulary).finditer(_PASSED_OVER.sub("", text)):
        if word := found["word"]:
            words += NORMAL.get(word, word).split()
            continue
        slots[f"#{len(words)}"] = slot = _slot(found, vocabulary, fps)
        words.append(slot.form)
    return tuple(words), slots


def _slot(found: re.Match[str], vocabulary: Vocabulary, fps: float) -> _Slot:
    if found["frame"]:
        return _Slot("F", found[0], number=int(found["frame"]))
    if seconds := found["seconds"]:  # rounded to 0.1 s, as people write them, they are at most one frame off
        return _Slot("F", found[0], number=int(round(float(seconds) * fps, 3)))
    if number := found["number"]:
        return _Slot("Q" if _number(number) == 1 else "QS", number, number=_number(number))
    if word := found["adjective"]:
        return _Slot("W", word, ObjectPhrase(word, (vocabulary.adjectives[word],)))
    if found["it"]:
        return _Slot("N", "it", ObjectPhrase("it", (), known=False))
    shape, form = vocabulary.nouns[found["noun"]]
    words = (*(vocabulary.adjectives[w] for w in re.findall(r"\w+", found["words"])), *((shape,) if shape else ()))
    article = found["article"] or ""
    if article in NUMBERS or article.isdigit():
        number = _number(article)
        return _Slot("K" if number < 2 else "KS", found[0], ObjectPhrase(found[0], words, False), number)
    form = form if form == "NS" else "A" if article in ("a", "an") else "N"
    return _Slot(form, found[0], ObjectPhrase(found[0], words, form == "N"))


def _number(word: str) -> int:
    return int(word) if word.isdigit() else NUMBERS.index(word)


def _statements(line: tuple[str, ...], slots: dict[str, _Slot], vocabulary: Vocabulary) -> tuple[Statement, ...]:
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
        statement = _statement([*context, *tokens], slots, vocabulary)
        if statement is None:
            return ()
        statements.append(statement)
    return tuple(statements)


def _statement(tokens: list[str], slots: dict[str, _Slot], vocabulary: Vocabulary) -> Statement | None:
    """The statement of a clause; None if it says something twice, or what does not go with its kind."""
    pending: list[_Slot] = []
    events: list[EventPhrase] = []
    said: list[tuple[str, Any]] = []

    def phrases() -> tuple[ObjectPhrase, ...]:
        found = tuple(slot.phrase for slot in pending if slot.phrase)
        pending.clear()
        return found

    for token in tokens:
        name, given, value = token.partition("=")
        if token in slots:
            pending.append(slots[token])
        elif given:
            said.append((name, _VALUES[name](value) if name in _VALUES else value))
        elif token in PAST_KINDS:
            events.append(EventPhrase(token, phrases()))
        elif token == "at" and events and events[-1].frame is None:
            events[-1] = replace(events[-1], frame=pending.pop().number)
        elif token in ("at", "frame", "number"):
            said.append((token.replace("at", "frame"), pending.pop().number))
        elif token == "who":
            said += [("number", slot.number) for slot in pending if slot.number is not None]
            said.append(("objects", phrases()))
        elif token == "without":
            said.append(("removed", phrases()[0]))
        elif token == "words":
            said.append(("words", tuple(word for phrase in phrases() for word in phrase.words)))
    fields = dict(said)
    modal, later = fields.pop("modal", False), fields.pop("later", False)
    if len(dict(said)) < len(said) or (modal and not (later or "removed" in fields)):
        return None
    return _complete(Statement(**{"kind": "event", **fields}, events=tuple(events)), later, vocabulary)


def _complete(said: Statement, later: bool, vocabulary: Vocabulary) -> Statement | None:
    """The statement with its kind and frame in place; None if it says what does not go with its kind."""
    event = said.events[0] if said.events else None
    course = "future" if later else "counterfactual" if said.removed else ""
    if later and said.removed:
        return None
    if said.kind == "event":
        assert event is not None
        if said.relation or said.frame is None:
            valid = not said.relation or (event.frame is None and not course)
            return replace(said, kind=course or PAST_KINDS[event.kind]) if valid else None
        event = replace(event, frame=said.frame) if event.frame is None else None
        return replace(said, kind=course or PAST_KINDS[event.kind], frame=None, events=(event,)) if event else None
    if said.kind == "count" and event:
        said = replace(said, kind="future") if later and event.kind == "collision" and not said.relation else said
        valid = (
            event.frame is None and (said.frame is None or bool(said.relation)) and (not course or said.kind == course)
        )
    elif said.kind in ("motion", "count"):
        if said.frame is not None and said.words == ("ever moving",):
            said = replace(said, words=("moving",))
        over_video = said.words[0] not in STATES
        valid = not course and ((said.kind == "motion" and said.frame is None) or over_video == (said.frame is None))
    else:
        valid = not course and said.frame is None
        if said.attribute:
            valid &= len(said.words) == 1 and said.words[0] in vocabulary.words[said.attribute]
    return said if valid else None


@lru_cache(maxsize=1 << 12)
def written(statement: Statement, vocabulary: Vocabulary) -> str:
    """The sentence that tells a statement in the words of a vocabulary; `read_sentence` reads it back."""
    slots: list[_Slot] = []
    line = _line(statement, slots, vocabulary)
    words = GRAMMAR.write("SENTENCE", line, [(slot.form,) for slot in slots])
    assert words is not None, f"{statement} has no sentence"
    text = " ".join(word if isinstance(word, str) else slots[word[1]].text for word in words)
    return re.sub(r" (?=[,:'])", "", f"{text[0].upper()}{text[1:]}.")


def _line(said: Statement, slots: list[_Slot], vocabulary: Vocabulary) -> list[str]:
    """The line of tokens of a statement, whose slots are appended to `slots`."""

    def slot(form: str, text: str) -> str:
        slots.append(_Slot(form, text))
        return f"#{len(slots) - 1}"

    def things(*phrases: ObjectPhrase) -> list[str]:
        return [slot("N" if p.definite else "A", p.text) for p in phrases]

    def at(frame: int | None, name: str) -> list[str]:
        return [] if frame is None else [slot("F", f"frame {frame}"), name]

    happening = said.kind in HAPPENING
    events, number = said.events, said.number if said.kind != "order" else None
    frame = None if said.relation else events[0].frame if happening else said.frame
    kind = "" if happening and number is None else "count" if happening else said.kind
    line = [*things(said.removed), "without", "|"] if said.removed else []
    line += ["later=yes", "|"] if said.kind == "future" else []
    line += [*at(frame, "frame"), "|"] if frame is not None else []
    many = "S" if number is not None and number > 1 else ""
    if number is not None and said.objects:
        text = f"{number or 'no'} {vocabulary.noun_phrase(said.objects[0].words, bool(many))}"
        line += [slot(f"K{many}", text), "who"]
    elif said.objects:
        line += [*things(*said.objects), "who"]
    elif number is not None:
        line += [slot(f"Q{many}", str(number)), "number"] if number else ["number=0"]
    for event in events:
        line += [*things(*event.objects), event.kind, *([] if happening else at(event.frame, "at"))]
    if kind == "attribute":
        noun = said.words[-1] in vocabulary.words["shape"] and not said.attribute
        line += (
            [slot("A", indefinite(vocabulary.noun_phrase(said.words)))] if noun else [slot("W", w) for w in said.words]
        )
        line.append("words")
    line += [f"kind={kind}"] if kind else []
    line += [f"words={said.words[0].replace(' ', '-')}"] if said.words and kind != "attribute" else []
    line += [f"attribute={said.attribute}"] if said.attribute else []
    line += [f"number={said.number}"] if said.number is not None and said.kind == "order" else []
    line += ["negated=yes"] * said.negated + ["modal=yes"] * bool(said.removed)
    line += at(said.frame, "frame") if said.relation else []
    return line + [f"relation={said.relation}"] * (bool(said.relation) or (said.kind == "count" and bool(events)))
