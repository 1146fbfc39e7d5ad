"""Programs of texts by a language model on a server that speaks OpenAI's protocol (the extra `llm`)."""

import os
import re
from collections.abc import Iterator, Sequence
from copy import copy
from functools import cache
from importlib.resources import files
from typing import Any

from nsdr.errors import DataError, EndpointError, NsdrError, ProgramError, QuestionError
from nsdr.io.reading import parse_json
from nsdr.language.reserved import check_vocabulary
from nsdr.language.texts import kind_of
from nsdr.question_parser.base import Parser
from nsdr.question_parser.grammar import another_kind, check_text, unless_confirmed
from nsdr.question_parser.tokenizer import decoder_tokens
from nsdr.symbolic.program import Program
from nsdr.symbolic.reference import reference_page
from nsdr.world.vocabulary import CLEVRER, Vocabulary

TIMEOUT_S = 120.0
"""Default of the longest time without anything from the server (s)."""
NO_PROGRAM = "NONE"
"""Reply for a text that no program stands for."""
QUOTED_CHARACTERS = 200
"""Length of what an error quotes of a reply."""
NAMED_MODELS = 5
"""Models that an error names."""
KEY_VARIABLE = "OPENAI_API_KEY"
"""Environment variable with the key that the server wants, if it wants one."""
LEAVE_OUT = "or take the question parser grammar, which needs no server"


def is_address(url: str) -> bool:
    """Whether a text may be the address of a server; one with a password or query is none."""
    return re.fullmatch(r"https?://[^\s/:?#@]+(:[1-9]\d*)?(/[^\s?#@]*)?", url) is not None


class LanguageModelParser(Parser):
    """Parses texts with a language model alone. The first program in its reply is taken if it is one of the kind of text.

    Args:
        url: base address of an OpenAI-compatible server, such as "http://localhost:8000/v1". The environment variable
            OPENAI_API_KEY, if it is set, is sent as the key, to this address only: redirects are errors.
        model: the model's name; "" for the only one that the server has.
        timeout_s: longest time without anything from the server (s).
        vocabulary: the words of objects.

    Raises:
        DataError: an address of another form, or the package openai is not installed.
        EndpointError: the server does not answer or refuses; without `model`, it has no model or several.
    """

    def __init__(
        self, url: str, model: str = "", timeout_s: float = TIMEOUT_S, vocabulary: Vocabulary = CLEVRER
    ) -> None:
        check_vocabulary(vocabulary)
        self.vocabulary = vocabulary
        if not is_address(url):
            shown = url.rpartition("@")[2]
            raise DataError(
                f"url is {shown!r:.200}; expected an address such as http://localhost:8000/v1, without a password"
            )
        try:
            import openai
        except ImportError as e:
            raise DataError(
                "a language model as question parser needs the package openai: pip install 'nsdr[llm]'"
            ) from e
        self.url, self.timeout_s = url.rstrip("/"), timeout_s
        self._openai = openai
        self._client = openai.OpenAI(
            base_url=self.url,
            api_key=os.environ.get(KEY_VARIABLE) or "none",
            timeout=timeout_s,
            max_retries=0,
            http_client=openai.DefaultHttpxClient(follow_redirects=False),
        )
        self.model = model  # named in errors
        self.model = model or self._only_model()

    def parse_batch(self, texts: Sequence[str], kind: str = "descriptive") -> list[Program | NsdrError]:
        """See `Parser`. The server gets one text after the other.

        A program that the rules do not read from the text has a note that says it in words.
        """
        found: list[Program | NsdrError] = []
        for text in texts:
            try:
                check_text(text, kind)
                found.append(self._asked(" ".join(text.split()), kind))
            except EndpointError:
                raise
            except NsdrError as e:
                found.append(e)
        return found

    def in_words(self, vocabulary: Vocabulary) -> "LanguageModelParser":
        """See `Parser`."""
        other = copy(self)
        other.vocabulary = vocabulary
        return other

    def _only_model(self) -> str:
        listed = getattr(self._requested("/models", self._client.models.list), "data", None)
        names = [str(getattr(row, "id", row)) for row in listed or ()]
        if len(names) != 1:
            shown = ", ".join(f"{name!r:.80}" for name in names[:NAMED_MODELS]) + (", …" * (len(names) > NAMED_MODELS))
            raise EndpointError(
                f"{self.url}: has {len(names)} models ({shown or 'none'}); name one after the address: {self.url}#MODEL"
            )
        return names[0]

    def _asked(self, text: str, kind: str) -> Program:
        completion = self._requested(
            "/chat/completions",
            self._client.chat.completions.create,
            model=self.model,
            messages=_messages(text, kind, self.vocabulary),
            temperature=0,
        )
        try:
            choice = completion.choices[0]
            reply, reason = choice.message.content, choice.finish_reason
        except (AttributeError, IndexError, TypeError):
            reply = reason = None
        if reason == "length":
            raise QuestionError(
                f"{self.url}: the reply of {self.model!r:.80} is cut off; let the server write longer replies"
            )
        if not isinstance(reply, str):
            raise EndpointError(
                f"{self.url}: not the reply of an OpenAI-compatible server; is the address right (it mostly ends in /v1)?"
            )
        program = _first_program(reply, text, self.model, self.vocabulary)
        if kind_of(program) != kind:
            raise another_kind(text, kind)
        return unless_confirmed(program, text, kind)

    def _requested(self, path: str, request: Any, **arguments: Any) -> Any:
        """The reply to a request of the client.

        Raises:
            EndpointError: the server does not answer, or not with success.
        """
        openai = self._openai
        try:
            return request(**arguments)
        except openai.APITimeoutError as e:
            text = f"no reply within {self.timeout_s:g} s; use a faster model, {LEAVE_OUT}"
            raise EndpointError(f"{self.url}: {text}") from e
        except openai.APIStatusError as e:
            body = e.body.get("message") if isinstance(e.body, dict) else e.body
            said = " ".join(str(body or e.message).split())
            remedy = f"see the server's log, {LEAVE_OUT}"
            if isinstance(e, openai.AuthenticationError | openai.PermissionDeniedError):
                remedy = f"set {KEY_VARIABLE} to a key that it takes"
            elif isinstance(e, openai.NotFoundError):
                remedy = f"is the address right (it mostly ends in /v1), and does it have the model {self.model!r:.80}?"
            raise EndpointError(
                f"{self.url}: the server answers {e.status_code} to {path}: {said!r:.{QUOTED_CHARACTERS}}; {remedy}"
            ) from e
        except (openai.OpenAIError, ValueError, TypeError) as e:
            cause = str(e.__cause__ or e)
            raise EndpointError(
                f"{self.url}: no server answers ({cause!r:.{QUOTED_CHARACTERS}}); start it, {LEAVE_OUT}"
            ) from e


@cache
def examples(vocabulary: Vocabulary) -> dict[str, dict[str, str]]:
    """Texts and programs that the model is shown, by kind of text, in the words of a vocabulary."""
    content: dict[str, dict[str, str]] = parse_json(
        files("nsdr.question_parser").joinpath("examples.json").read_bytes(), "examples.json"
    )
    return {
        kind: {_recast(text, vocabulary): _recast(program, vocabulary) for text, program in pairs.items()}
        for kind, pairs in content.items()
    }


def _recast(text: str, vocabulary: Vocabulary) -> str:
    """A text in CLEVRER's words with the vocabulary's word of the same number in place of each, modulo how many there are."""
    others = {
        word: words[i % len(words)]
        for name, words in vocabulary.words.items()
        for i, word in enumerate(CLEVRER.words[name])
    }
    others |= {
        shape.plurals[shape.word]: vocabulary.noun_phrase([others[shape.word]], is_plural=True)
        for shape in CLEVRER.shapes
    }
    return re.sub(r"\w+", lambda word: others.get(word[0], word[0]), text)


def _messages(text: str, kind: str, vocabulary: Vocabulary) -> list[dict[str, str]]:
    rules = _recast(files("nsdr.question_parser").joinpath("prompt.md").read_text("utf-8"), vocabulary)
    messages = [{"role": "system", "content": rules.replace("MODULES", reference_page(vocabulary))}]
    for example, program in examples(vocabulary)[kind].items():
        messages.append({"role": "user", "content": f"{kind}: {example}"})
        messages.append({"role": "assistant", "content": program})
    return [*messages, {"role": "user", "content": f"{kind}: {text}"}]


def _first_program(reply: str, text: str, model: str, vocabulary: Vocabulary) -> Program:
    """The first well-formed program of a reply.

    Raises:
        QuestionError: there is none; quotes the reply.
    """
    error: ProgramError | None = None
    for source in _candidates(reply, vocabulary):
        if source == NO_PROGRAM:
            break
        try:
            return Program.parse(source, vocabulary)
        except ProgramError as e:
            error = error or e
    else:
        why = f" ({error})" if error else ""
        raise QuestionError(
            f"{text!r}: the reply of {model!r:.80} holds no program{why}: {reply.strip()!r:.{QUOTED_CHARACTERS}}; word the "
            "text like a question of the data set, or use another model"
        )
    raise QuestionError(f"{text!r} fits no program, says {model!r:.80}; word it like a question of the data set")


def _candidates(reply: str, vocabulary: Vocabulary) -> Iterator[str]:
    """Lines, their ends after a colon, and quotations in backticks, that hold tokens only; and `NO_PROGRAM`.

    What a reasoning model thinks aloud, up to `</think>`, is passed over.
    """
    known = frozenset(decoder_tokens(vocabulary))
    for line in reply.rpartition("</think>")[2].splitlines():
        for part in (line.rpartition(":")[2], *re.findall(r"`([^`]+)`", line)):
            names = re.findall(r"\w+", part)
            if names == [NO_PROGRAM]:
                yield NO_PROGRAM
            elif names and known.issuperset(name.lower() for name in names):
                yield part.strip(" \t`*'\".,;") if "(" in part else " ".join(names)
