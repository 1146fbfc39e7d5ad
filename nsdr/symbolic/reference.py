"""The reference page of program modules, generated from the signature table: `python -m nsdr.symbolic.reference`."""

from collections.abc import Mapping

from nsdr.symbolic.modules import EXTENSION_WORDS, MODULES, Kind, Module, program_words
from nsdr.world.vocabulary import CLEVRER, Vocabulary

HEAD = "| token | arguments | result | meaning |\n|---|---|---|---|\n"


def reference_page(vocabulary: Vocabulary) -> str:
    """The modules of CLEVRER's programs and the released executor, and the words of a vocabulary's programs, as Markdown."""
    rows = [_row(m) for m in MODULES.values() if m.in_data_set]
    released_only = [_row(m) for m in MODULES.values() if not m.in_data_set and not m.extension]
    return f"""# Program modules

<!-- Generated from the signature table: python -m nsdr.symbolic.reference > docs/api/modules.md -->

A program is a postfix list of tokens: words, and modules that take their arguments from the stack, the first argument
deepest. `nsdr.Program.parse` also reads the released executor's names.

## Modules

{HEAD}{chr(10).join(rows)}

## Modules of the released executor only

{HEAD}{chr(10).join(released_only)}

## Words

{_words(program_words(vocabulary))}
"""


def extension_page() -> str:
    """What is beyond CLEVRER, as Markdown."""
    rows = [_row(m) for m in MODULES.values() if m.extension]
    return f"""
## Beyond CLEVRER

For questions that CLEVRER does not ask (see [question forms](../questions.md#beyond-clevrer)); `query_direction` above has a
meaning, too. What a scene does not know, or not surely enough, is an error. No program of the data set has them, nor does
the trained question parser.

{HEAD}{chr(10).join(rows)}

{_words(EXTENSION_WORDS)}
"""


def _words(words: Mapping[str, Kind]) -> str:
    kinds = dict.fromkeys(words.values())
    return "\n".join(f"- {kind}: {', '.join(f'`{w}`' for w, k in words.items() if k == kind)}" for kind in kinds)


def _row(module: Module) -> str:
    arguments = ", ".join(" or ".join(kinds) for kinds in module.arguments) or "-"
    single = f"{Kind.OBJECT} or {Kind.EVENT}"
    return f"| `{module.name}` | {arguments} | {module.result or single} | {module.meaning} |"


if __name__ == "__main__":
    print(reference_page(CLEVRER) + extension_page(), end="")
