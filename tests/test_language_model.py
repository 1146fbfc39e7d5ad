"""The question parser on a server, against a local stub of one."""

import json
import subprocess
import sys
import threading
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from nsdr.clevrer.example import QUESTIONS, TRUTH
from nsdr.cli.main import main
from nsdr.errors import DataError, EndpointError, QuestionError
from nsdr.evaluation import EvaluationConfig
from nsdr.question_parser import LanguageModelParser, load_parser
from nsdr.question_parser.grammar import readings
from nsdr.question_parser.language_model import KEY_VARIABLE, NO_PROGRAM, examples
from nsdr.world.vocabulary import CLEVRER

TEXT = "How many red cubes enter the scene?"
PROGRAM = "events objects red filter_color cube filter_shape filter_in count"


class Stub:
    """A server that replies what a test says.

    Attributes:
        reply: content of the chat message.
        body: whole body of the reply, in place of one with `reply`.
        status: of the reply.
        models: names it lists; None answers 404.
        hangs: whether a chat gets no reply until the server stops.
        drips: whether it gets one byte at a time until then.
        asked: (path, headers, body) of the requests.
    """

    def __init__(self):
        self.reply, self.body, self.status = PROGRAM, None, 200
        self.models, self.headers, self.hangs, self.drips, self.asked = ["small"], {}, False, False, []
        self.stopped = threading.Event()
        stub = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                stub.asked.append((self.path, dict(self.headers), None))
                if stub.models is None:
                    self.send(404, b"nothing here")
                else:
                    self.send(200, json.dumps({"data": [{"id": name} for name in stub.models]}).encode())

            def do_POST(self):
                length = int(self.headers["Content-Length"])
                stub.asked.append((self.path, dict(self.headers), json.loads(self.rfile.read(length))))
                if stub.hangs:
                    stub.stopped.wait()
                    return
                if stub.drips:
                    self.send(200, b" ")
                    with suppress(OSError):
                        while not stub.stopped.wait(0.02):
                            self.wfile.write(b" ")
                    return
                message = {"choices": [{"message": {"role": "assistant", "content": stub.reply}}]}
                self.send(stub.status, json.dumps(message).encode() if stub.body is None else stub.body)

            def send(self, status, content):
                self.send_response(status)
                for name, value in stub.headers.items():
                    self.send_header(name, value)
                self.end_headers()
                self.wfile.write(content)

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}/v1"
        self.thread = threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.01})

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.stopped.set()
        self.server.shutdown()
        self.thread.join()
        self.server.server_close()


@pytest.fixture
def stub(monkeypatch):
    for name in (KEY_VARIABLE, "http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    with Stub() as server:
        yield server


@pytest.fixture
def parser(stub):
    return LanguageModelParser(stub.url, "small", timeout_s=30)


def test_the_request_has_the_table_examples_and_the_text(stub, parser) -> None:
    assert str(parser.parse(TEXT)) == PROGRAM
    path, headers, body = stub.asked[-1]
    assert path == "/v1/chat/completions"
    assert {name.lower(): value for name, value in headers.items()}["authorization"] == "Bearer none"
    assert (body["model"], body["temperature"]) == ("small", 0)
    assert "| `filter_in` | events, objects or object | events |" in body["messages"][0]["content"]
    assert body["messages"][-1] == {"role": "user", "content": f"descriptive: {TEXT}"}
    assert {"role": "assistant", "content": NO_PROGRAM} in body["messages"]


def test_the_examples_are_right() -> None:
    for kind, texts in examples(CLEVRER).items():
        assert NO_PROGRAM in texts.values()
        for text, program in texts.items():
            assert readings(text, kind, CLEVRER) == ([] if program == NO_PROGRAM else [program.split()])


@pytest.mark.parametrize(
    "reply",
    [
        f"{PROGRAM}\n",
        f"Program: {PROGRAM}",
        f"Let me see: the cubes are counted.\n\n```text\n{PROGRAM}\n```\nI hope that helps!",
        f"`filter_in` takes events, so it is `{PROGRAM}`.",
        f"<think>objects count\nNo, the red ones.</think>\n{PROGRAM}",
        json.dumps({"program": PROGRAM.split()}),
        f"{PROGRAM}\nobjects count",
        f"{PROGRAM}\x00",
    ],
)
def test_the_first_program_of_a_reply_counts(stub, parser, reply) -> None:
    stub.reply = reply
    assert str(parser.parse(TEXT)) == PROGRAM


@pytest.mark.parametrize(
    ("reply", "reason"),
    [
        ("", "holds no program"),
        ("There are three red cubes.", r"the reply of 'small' holds no program: 'There are three"),
        ("events objects red filter_color count count", r"holds no program \(2 values|holds no program \(token"),
        ("objects red filter_colour cube filter_shape count", "holds no program"),
        ("objects counterfact_events count", "holds no program"),
        ("count " * 2000, r"holds no program \(the program has more than 1000 tokens"),
        ("NONE", "fits no program, says 'small'"),
        (f"I think:\n`NONE`\n{PROGRAM}", "fits no program, says 'small'"),
        ("unseen_events belong_to", "is not a descriptive question"),
        ("events objects red filter_color cube filter_shape unique filter_in unique", "is not a descriptive question"),
    ],
)
def test_other_replies_are_refused(stub, parser, reply, reason) -> None:
    stub.reply = reply
    with pytest.raises(QuestionError, match=reason) as caught:
        parser.parse(TEXT)
    assert not isinstance(caught.value, EndpointError)
    assert "\n" not in str(caught.value)


def test_each_kind_has_its_results(stub, parser) -> None:
    stub.reply = "unseen_events belong_to"
    assert parser.parse("What will happen next?", "multiple_choice").needs_choice
    with pytest.raises(QuestionError, match="is not a choice"):
        parser.parse("What will happen next?", "choice")
    stub.reply = "objects red filter_color cube filter_shape unique"
    assert parser.parse("the presence of the red cube", "choice").result == "object"
    with pytest.raises(QuestionError, match="is not a multiple-choice question"):
        parser.parse("the presence of the red cube", "multiple_choice")


@pytest.mark.parametrize(
    ("text", "kind", "reason"),
    [("", "descriptive", "empty"), ("\U0001f642?", "descriptive", "character"), (TEXT, "zebra", "kind is 'zebra'")],
)
def test_texts_are_checked_before_they_are_sent(stub, parser, text, kind, reason) -> None:
    with pytest.raises(QuestionError, match=reason):
        parser.parse(text, kind)
    with pytest.raises(DataError, match="text_characters"):
        parser.parse("a " * 100_000)
    assert not stub.asked


@pytest.mark.parametrize(
    ("status", "body", "reason"),
    [
        (
            500,
            b'{"error": {"message": "out of memory"}}',
            "answers 500 to /chat/completions: .*out of memory.*; see the se",
        ),
        (503, b"\xff\x00busy\x1b[31m", "answers 503 .*; see"),
        (400, b"", "answers 400 to /chat/completions: .*; see"),
        (401, b"{}", f"answers 401 .*; set {KEY_VARIABLE}"),
        (404, b'{"error": "no such model"}', "no such model.*; is the address right .* the model 'small'"),
        (302, b"", "answers 302 to /chat/completions"),
        (200, b"<html>hello</html>", "not the reply of an OpenAI-compatible server|no server answers"),
        (200, b"\x1f\x8b\x00\x00", "not the reply of an OpenAI-compatible server|no server answers"),
        (200, b'{"choices": ', "not the reply of an OpenAI-compatible server|no server answers"),
        (200, b"{}", "not the reply of an OpenAI-compatible server"),
        (200, b'{"choices": []}', "not the reply of an OpenAI-compatible server"),
        (200, b'{"choices": [{"message": {"content": null}}]}', "not the reply of an OpenAI-compatible server"),
    ],
)
def test_failures_of_the_server_name_it_and_the_remedy(stub, parser, status, body, reason) -> None:
    stub.status, stub.body, stub.headers = status, body, {"Location": "http://127.0.0.1:9/"} if status == 302 else {}
    with pytest.raises(EndpointError, match=reason) as caught:
        parser.parse(TEXT)
    assert stub.url in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 500


def test_a_cut_off_reply_is_refused(stub, parser) -> None:
    choice = {"message": {"content": PROGRAM}, "finish_reason": "length"}
    stub.body = json.dumps({"choices": [choice]}).encode()
    with pytest.raises(QuestionError, match="the reply of 'small' is cut off"):
        parser.parse(TEXT)


def test_a_server_that_hangs_is_left(stub) -> None:
    stub.hangs = True
    with pytest.raises(
        EndpointError, match=r"no reply within 0.2 s; use a faster model, or take the question parser grammar"
    ):
        LanguageModelParser(stub.url, "small", timeout_s=0.2).parse(TEXT)


def test_no_server() -> None:
    with Stub() as stopped:
        url = stopped.url
    with pytest.raises(EndpointError, match=rf"{url}: no server answers .*; start it"):
        LanguageModelParser(url, "small").parse(TEXT)


@pytest.mark.parametrize(
    "url",
    ["", "localhost:8000", "ftp://host/v1", "file:///etc/passwd", "http://", "http://host:zebra/v1", "http://host:0/v1",
     "http://ho st/v1", "http://host/v1\n", "http://host/v1?a=b", "http://host/v1#a", "http://user:secret@host/v1"],
)  # fmt: skip
def test_addresses_are_checked(url) -> None:
    with pytest.raises(DataError, match="url is") as caught:
        LanguageModelParser(url, "small")
    assert "secret" not in str(caught.value)


def test_the_only_model_is_taken(stub) -> None:
    parser = LanguageModelParser(stub.url + "/")
    assert str(parser.parse(TEXT)) == PROGRAM
    assert stub.asked[-1][2]["model"] == "small"


@pytest.mark.parametrize(
    ("models", "reason"),
    [
        ([], r"has 0 models \(none\); name one after the address: http://.*#MODEL"),
        (["a", "b"], r"has 2 models \('a', 'b'\); name one"),
        (list("abcdefgh"), r"'e', …\); name one"),
        (None, "answers 404 to /models"),
    ],
)
def test_without_a_model_there_must_be_one(stub, models, reason) -> None:
    stub.models = models
    with pytest.raises(EndpointError, match=reason):
        LanguageModelParser(stub.url)
    assert LanguageModelParser(stub.url, "a").model == "a"


def test_the_models_name_follows_the_address(stub) -> None:
    stub.models = ["a", "b/c:8d"]
    parser = load_parser(f"{stub.url}#b/c:8d")
    assert str(parser.parse(TEXT)) == PROGRAM
    assert stub.asked[-1][2]["model"] == "b/c:8d"
    with pytest.raises(EndpointError, match="has 2 models"):
        load_parser(stub.url)


def test_programs_that_the_rules_do_not_read_are_noted(stub, parser) -> None:
    assert parser.parse(TEXT).notes == ()
    assert "How many red cubes enter the scene" in "".join(parser.parse("Many red cubes enter the scene, how?").notes)
    stub.reply = PROGRAM.replace("red", "blue")
    assert "How many blue cubes enter the scene" in "".join(parser.parse(TEXT).notes)


def test_the_key_is_sent_if_it_is_set(stub, monkeypatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, "sk-1")
    LanguageModelParser(stub.url, "small").parse(TEXT)
    assert {name.lower(): value for name, value in stub.asked[-1][1].items()}["authorization"] == "Bearer sk-1"


def test_commands_use_the_server(stub, capsys) -> None:
    assert main(["program", TEXT, "--question-parser", stub.url, "--kind", "descriptive"]) == 0
    assert capsys.readouterr().out.strip() == PROGRAM
    stub.reply = "events objects filter_collision count"
    assert main(["answer", str(TRUTH), "How many collisions happen?", "--question-parser", stub.url]) == 0
    assert capsys.readouterr().out.strip() == "4"


def test_nothing_imports_the_client_unless_asked() -> None:
    code = "import nsdr.cli.main, nsdr.question_parser.loading, nsdr.question_parser.language_model, sys; "
    code += "sys.exit(any(m in sys.modules for m in ('openai', 'torch')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--question-parser", "zebra"], "expected grammar, network, or a server's address"),
        (
            ["--question-parser", "http://localhost:1/v1", "--checkpoint", "propnet_patches"],
            "--checkpoint would do nothing with the",
        ),
        (["--checkpoint", "propnet_patches"], "--checkpoint would do nothing with the question parser grammar"),
    ],
)
def test_options_are_checked(arguments, reason, capsys) -> None:
    assert main(["program", TEXT, *arguments]) == 2
    assert reason in capsys.readouterr().err


def test_evaluations_are_checked() -> None:
    with pytest.raises(DataError, match="question_parser would do nothing with programs gold"):
        EvaluationConfig(questions="q", data="d", question_parser="http://host/v1", programs="gold")


def test_a_server_that_fails_ends_an_evaluation(stub, capsys, tmp_path) -> None:
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    (scenes / "scene_500002.json").write_bytes(TRUTH.read_bytes())
    questions = tmp_path / "questions.json"
    questions.write_text(QUESTIONS.read_text().replace("will happen next?", "will the future bring to these?"))
    arguments = ["evaluate", "--questions", str(questions), "--source", "scenes", "--data", str(scenes),
                 "--question-parser", stub.url,
                 "--cache", str(tmp_path / "cache"), "--types", "predictive"]  # fmt: skip
    stub.reply = "NONE"
    assert main(arguments) == 1
    assert "fits no program" in capsys.readouterr().err
    stub.status = 500
    assert main(arguments) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith(f"error: {stub.url}: the server answers 500")
    stub.models = None
    assert main(arguments) == 2
    assert "answers 404 to /models" in capsys.readouterr().err
