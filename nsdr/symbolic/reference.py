"""The reference page of program modules, generated from the signature table: `python -m nsdr.symbolic.reference`."""

from nsdr.symbolic.modules import MODULES, WORDS, Kind, Module

__all__ = ["reference_page"]


def reference_page() -> str:
    """The reference page as Markdown."""
    rows = [_row(m) for m in MODULES.values() if m.in_data_set]
    released_only = [_row(m) for m in MODULES.values() if not m.in_data_set]
    words = "\n".join(
        f"- {kind}: {', '.join(f'`{w}`' for w, k in WORDS.items() if k == kind)}"
        for kind in dict.fromkeys(WORDS.values())
    )
    head = "| token | arguments | result | meaning |\n|---|---|---|---|\n"
    return f"""# Program modules

<!-- Generated from the signature table: python -m nsdr.symbolic.reference > docs/modules.md -->

A program is a postfix list of tokens: words, and modules that take their arguments from the stack, the first argument
deepest. `nsdr.Program.parse` also reads the paper's trees, such as `Count(Filter_shape(Objects, "cube"))`, and the
released executor's names.

## Modules

{head}{chr(10).join(rows)}

## Modules of the released executor only

{head}{chr(10).join(released_only)}

## Words

{words}
"""


def _row(module: Module) -> str:
    arguments = ", ".join(" or ".join(kinds) for kinds in module.arguments) or "-"
    single = f"{Kind.OBJECT} or {Kind.EVENT}"
    return f"| `{module.name}` | {arguments} | {module.result or single} | {module.meaning} |"


if __name__ == "__main__":
    print(reference_page(), end="")
