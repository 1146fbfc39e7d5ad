import random
import subprocess
import sys

import pytest
import torch

from nsdr import CheckpointError, DataError, GrammarParser, Program, QuestionError, QuestionParser
from nsdr.io.checkpoint import load_checkpoint, save_checkpoint
from nsdr.language.normal import normal_form
from nsdr.language.texts import TEXT_KINDS, normal_words, read_paraphrases, sample
from nsdr.question_parser.base import Parser
from nsdr.question_parser.constraint import allowed, first_stack, following
from nsdr.question_parser.loading import load_parser
from nsdr.question_parser.model import ParserNetwork, QuestionParserConfig
from nsdr.question_parser.network import build_networks, pad
from nsdr.question_parser.tokenizer import END, Tokenizer, decoder_tokens, split_words
from nsdr.world.vocabulary import CLEVRER

TOKENS = decoder_tokens(CLEVRER)
OTHER_WORDINGS = [
    ("descriptive", "How many objects are there?", "objects count"),
    ("descriptive", "What colour is the ball?", "objects sphere filter_shape unique query_color"),
    ("descriptive", "Are there no collisions?", "events objects filter_collision exist negate"),
    (
        "descriptive",
        "Is the cube moving when the video ends?",
        "objects cube filter_shape unique end get_frame filter_moving exist",
    ),
    (
        "descriptive",
        "Did the red cube bump into the sphere?",
        "events objects red filter_color cube filter_shape unique filter_collision "
        "objects sphere filter_shape unique filter_collision exist",
    ),
    ("descriptive", "When does the cube enter?", "events objects cube filter_shape unique filter_in unique get_frame"),
    ("descriptive", "What will happen next?", "unseen_events"),
    (
        "multiple_choice",
        "What if we took the cube away?",
        "all_events objects cube filter_shape unique get_counterfact belong_to",
    ),
    (
        "choice",
        "The cube is hit by the sphere",
        "all_events objects sphere filter_shape unique filter_collision objects cube filter_shape unique "
        "filter_collision unique",
    ),
]


@pytest.fixture(scope="module")
def network() -> QuestionParser:
    return QuestionParser.from_pretrained(device="cpu")


@pytest.fixture(scope="module", params=["grammar", "network"])
def any_parser(request, network) -> Parser:
    return GrammarParser() if request.param == "grammar" else network


@pytest.fixture(scope="module")
def parser() -> Parser:
    return load_parser()


@pytest.mark.parametrize("kind", TEXT_KINDS)
def test_grammar_makes_well_typed_programs_of_known_length(kind: str) -> None:
    rng = random.Random(3)
    for _ in range(500):
        text, tokens = sample(kind, rng, CLEVRER)
        program = Program.parse(tokens)
        assert program.needs_choice == (kind == "multiple_choice")
        assert len(tokens) <= 36
        assert len(text.split()) <= 24


@pytest.mark.parametrize("kind", TEXT_KINDS)
def test_unseen_texts_are_parsed_exactly(any_parser: Parser, kind: str) -> None:
    rng = random.Random("predicted")
    pairs = [sample(kind, rng, CLEVRER) for _ in range(300)]
    programs = any_parser.parse_batch([text for text, _ in pairs], kind)
    assert [list(p.tokens) for p in programs if isinstance(p, Program)] == [tokens for _, tokens in pairs]


def test_case_spaces_punctuation_and_curly_quotes_do_not_matter(any_parser: Parser) -> None:
    expected = any_parser.parse("the red cube's exit", "choice")
    assert any_parser.parse("  The RED  cube\u2019s exit. ", "choice") == expected


def test_one_text_alone_gives_what_a_batch_gives(any_parser: Parser) -> None:
    texts = ["How many collisions happen?", "What color is the first metal object that enters the scene?"]
    assert any_parser.parse_batch(texts) == [any_parser.parse(t) for t in texts]
    assert any_parser.parse_batch([]) == []


def test_a_bad_text_does_not_lose_the_others(any_parser) -> None:
    texts = ["How many zebras are there?", "How many cubes enter the scene?", "", "How many \x00?"]
    found = any_parser.parse_batch(texts)
    assert [isinstance(program, QuestionError) for program in found] == [True, False, True, True]
    assert found[1] == any_parser.parse(texts[1])
    assert "zebras" in str(found[0])
    assert "kind is 'poem'" in str(any_parser.parse_batch(texts[1:2], "poem")[0])


def test_unknown_words_are_named_with_what_is_understood_without_them(parser: Parser) -> None:
    with pytest.raises(
        QuestionError, match=r"unknown word 'gleam'.*understood: What is the color of the moving object;"
    ):
        parser.parse("What color gleam is the moving object?")
    with pytest.raises(QuestionError, match="is empty"):
        parser.parse(" ?")


@pytest.mark.parametrize("text", ["the the the", "What is red", "How many cubes collide with the sphere?"])
def test_meaningless_texts_are_rejected(parser: Parser, text: str) -> None:
    with pytest.raises(
        QuestionError, match=r"(fits no program|is not a descriptive question).*word it like a question"
    ):
        parser.parse(text)


def test_texts_of_another_kind_are_rejected(parser: Parser) -> None:
    with pytest.raises(QuestionError, match="give choices with it"):
        parser.parse("Which of these is responsible for the cube's exit?")
    with pytest.raises(QuestionError, match="ask it without choices"):
        parser.parse("How many collisions happen?", "multiple_choice")
    with pytest.raises(QuestionError, match="is not a choice"):
        parser.parse("How many collisions happen?", "choice")
    with pytest.raises(QuestionError, match="kind is 'riddle'"):
        parser.parse("How many?", "riddle")


def test_network_learns_a_tiny_batch() -> None:
    torch.manual_seed(0)
    rng = random.Random(0)
    pairs = [sample("choice", rng, CLEVRER) for _ in range(4)]
    tokenizer = Tokenizer.from_texts(t for t, _ in pairs)
    index = {t: i for i, t in enumerate(TOKENS)}
    words = pad([tokenizer.encode(t) for t, _ in pairs])
    tokens = pad([[1, *(index[t] for t in p), 2] for _, p in pairs])
    net = ParserNetwork(len(tokenizer), len(TOKENS), QuestionParserConfig(embedding=32, hidden=64))
    optimizer = torch.optim.Adam(net.parameters(), 5e-3)
    for _ in range(300):
        loss = torch.nn.functional.cross_entropy(
            net(words, tokens[:, :-1]).flatten(0, 1), tokens[:, 1:].flatten(), ignore_index=0
        )
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    rows, probabilities = net.search(words, "choice", CLEVRER)
    assert [[TOKENS[t] for t in row] for row in rows] == [p for _, p in pairs]
    assert min(probabilities) > 0.5


def test_padding_does_not_change_the_result() -> None:
    torch.manual_seed(0)
    net = ParserNetwork(20, 30, QuestionParserConfig(embedding=8, hidden=16)).eval()
    words = torch.tensor([[3, 4, 5]])
    padded = torch.tensor([[3, 4, 5, 0, 0], [6, 7, 8, 9, 10]])
    tokens = torch.tensor([[1, 5, 6]])
    torch.testing.assert_close(net(words, tokens)[0], net(padded, tokens.expand(2, -1))[0])


def test_split_words() -> None:
    assert split_words("The cube's entrance, now?") == ["the", "cube", "'s", "entrance", "now"]


def test_a_checkpoint_with_other_tokens_is_rejected(tmp_path) -> None:
    config = QuestionParserConfig(embedding=8, hidden=8)
    networks = build_networks(5, len(TOKENS), config)
    details = {"words": ["a", "b", "c", "d"], "program_tokens": ["count"]}
    save_checkpoint(tmp_path, "question_parser", networks.state_dict(), config, details)
    with pytest.raises(CheckpointError, match="trained with other program tokens"):
        QuestionParser.from_checkpoint(tmp_path)
    state, _ = load_checkpoint(tmp_path, "question_parser")
    assert set(state) == set(networks.state_dict())


def test_a_saved_parser_gives_the_same_programs(network: QuestionParser, tmp_path) -> None:
    rng = random.Random(7)
    network.save_pretrained(tmp_path, {"metrics": {"exact": 1.0}})
    again = QuestionParser.from_pretrained(tmp_path, device="cpu")
    assert load_checkpoint(tmp_path, "question_parser")[1]["metrics"] == {"exact": 1.0}
    for kind in TEXT_KINDS:
        texts = [sample(kind, rng, CLEVRER)[0] for _ in range(20)]
        assert again.candidates(texts, kind) == network.candidates(texts, kind)


def test_a_parser_moves_to_a_device_or_says_why_not(network: QuestionParser, tmp_path) -> None:
    assert network.to("cpu") is network
    assert {p.device.type for p in network.networks.parameters()} == {"cpu"}
    assert list(network.parse("How many collisions happen?").tokens)[-1] == "count"
    with pytest.raises(DataError, match="device 'abacus'"):
        network.to("abacus")
    with pytest.raises(DataError, match="device 'abacus'"):
        QuestionParser.from_pretrained(device="abacus")
    with pytest.raises(CheckpointError, match="no checkpoint"):
        QuestionParser.from_pretrained(tmp_path / "none")


def test_the_shipped_parser_knows_the_words_of_all_wordings(network: QuestionParser) -> None:
    assert set(network.tokenizer.words) <= set(normal_words(CLEVRER))


def test_misspelt_words_are_corrected_with_a_note(parser: Parser) -> None:
    program, right = (parser.parse(f"How many {word} enter the scene?") for word in ("cylnders", "cylinders"))
    assert program == right
    assert program.notes == ("read 'cylnders' as 'cylinders'",)
    assert right.notes == ()


@pytest.mark.parametrize("row", OTHER_WORDINGS, ids=lambda row: row[1])
def test_other_wordings(parser: Parser, row: tuple[str, str, str]) -> None:
    kind, text, program = row
    assert str(parser.parse(text, kind)) == program


def test_candidates_leave_unknown_words_out(network: QuestionParser) -> None:
    texts = ["How many gleaming cubes enter the scene?", "How many cubes enter the scene?", "zork"]
    found = [tokens for tokens, _ in network.candidates(texts)]
    assert found[0] == found[1] == ["events", "objects", "cube", "filter_shape", "filter_in", "count"]
    assert found[2] == ["<other>"]


def test_rules_need_no_torch(tmp_path) -> None:
    code = "import sys; from nsdr.cli.main import main; main(['program', 'How many cubes enter the scene?']); "
    code += "sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, capture_output=True).returncode == 0


@pytest.mark.parametrize("kind", TEXT_KINDS)
def test_untrained_networks_decode_well_typed_programs_only(kind: str) -> None:
    torch.manual_seed(1)
    config = QuestionParserConfig(embedding=16, hidden=16, max_tokens=200)
    rng = random.Random(1)
    texts = [sample(kind, rng, CLEVRER)[0] for _ in range(20)]
    tokenizer = Tokenizer.from_texts(normal_form(text).text for text in texts)
    networks = build_networks(len(tokenizer), len(TOKENS), config)
    tokens = [t for t, _ in QuestionParser(tokenizer, networks).candidates(texts, kind)]
    ended = [t for t in tokens if len(t) < 200 and "<other>" not in t]
    for program in ended:
        assert Program.parse(program).needs_choice == (kind == "multiple_choice")


@pytest.mark.parametrize("kind", TEXT_KINDS)
def test_the_constraint_permits_every_program_of_the_grammar(kind: str) -> None:
    rng = random.Random(2)
    index = {t: i for i, t in enumerate(TOKENS)}
    for _ in range(300):
        stack = first_stack(kind)
        for step, token in enumerate([index[t] for t in sample(kind, rng, CLEVRER)[1]]):
            assert allowed(stack, kind, step == 0, CLEVRER)[token]
            stack = following(stack, token, CLEVRER)
        assert allowed(stack, kind, False, CLEVRER)[END]


def test_paraphrases_are_well_typed_and_not_in_the_grammar(network: QuestionParser) -> None:
    rows = read_paraphrases()
    assert len(rows) >= 200
    assert len({row["text"] for row in rows}) == len(rows)
    for row in rows:
        assert Program.parse(row["program"]).needs_choice == (row["kind"] == "multiple_choice")
    rng = random.Random(4)
    grammar = {sample(kind, rng, CLEVRER)[0] for kind in TEXT_KINDS for _ in range(5000)}
    assert not grammar & {row["text"] for row in rows}


def test_a_text_without_words_is_refused(parser: Parser) -> None:
    for text in ("Please.", "so, thanks"):
        with pytest.raises(QuestionError, match="fits no program"):
            parser.parse(text, "choice")


def test_a_text_without_a_reading_is_read_by_what_it_mentions_and_that_is_said(parser: Parser) -> None:
    program = parser.parse("When the red block comes in, there is a green object in motion: what shape is it?")
    (note,) = program.notes
    assert note == "read as 'What is the shape of the moving green object when the red cube enters the scene'"


def test_programs_of_the_network_that_the_rules_do_not_read_are_noted(network: QuestionParser, parser: Parser) -> None:
    assert network.parse("How many cubes are there?").notes == ()
    text = "What color the sphere?"
    with pytest.raises(QuestionError, match="fits no program"):
        parser.parse(text)
    assert network.parse(text).notes == ("read as 'What is the color of the sphere'",)


def test_parsers_are_chosen_by_name(tmp_path) -> None:
    assert isinstance(load_parser("grammar", tmp_path / "no weights are needed"), GrammarParser)
    assert isinstance(load_parser("network", device="cpu"), QuestionParser)
    for name in ("zebra", "localhost:8000", "http://user:secret@host/v1"):
        with pytest.raises(DataError, match="expected grammar, network, or a server's address") as caught:
            load_parser(name)
        assert "secret" not in str(caught.value)
    with pytest.raises(DataError, match="extensions would do nothing with question_parser 'network'"):
        load_parser("network", extensions=True)
