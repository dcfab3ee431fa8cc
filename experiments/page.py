"""The report's page: `page.md`, which a person wrote, with numbers, figures and tables filled in by name.

Blocks are separated by blank lines. `${name}` is a number of `experiments.named`, `${table.name}` a table, a picture a
figure. A comment before a block says what must be so for its text to be true, `name = value; ...`; where results say
otherwise, the page says so in front of the text, and a test of the kept results fails.
"""

import base64
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import groupby
from pathlib import Path
from string import Template

from experiments.entries import NOT_RUN
from experiments.table import Table, to_html, to_markdown

TEXT, SHELL = Path(__file__).with_name("page.md"), Path(__file__).with_name("page.html")
NAME = re.compile(r"\$\{([^}]+)\}")
PICTURE = re.compile(r"!\[(.*)\]\(figures/(.*)\.svg\)", re.DOTALL)
TABLE = re.compile(r"\$\{table\.([^}]+)\}")
NO_TABLE = "Not run: no part of this study."
NOT_DRAWN = "Not run: no race of four has been kept yet."


@dataclass(frozen=True)
class Block:
    """A paragraph, a heading, an item of a list, a picture or a table, and what its text takes for granted."""

    text: str
    asserts: Mapping[str, str]

    @property
    def names(self) -> list[str]:
        """Of its numbers and tables."""
        return NAME.findall(self.text)

    def contradictions(self, values: Mapping[str, str]) -> list[str]:
        """What is not as the text takes for granted."""
        return [
            f"{name} is {values[name]}, not {value}" for name, value in self.asserts.items() if values[name] != value
        ]

    def filled(self, values: Mapping[str, str]) -> str:
        """The text with its numbers; where it is not true of these results, with a warning in front."""
        text = NAME.sub(lambda found: values[found[1]], self.text)
        wrong = self.contradictions(values)
        if not wrong:
            return text
        unknown = all(values[name] in (NOT_RUN, value) for name, value in self.asserts.items())
        told = "Not known from these results" if unknown else f"Not so in these results ({'; '.join(wrong)})"
        bullet, rest = ("- ", text[2:]) if text.startswith("- ") else ("", text)
        return f"{bullet}**{told}.** {rest}"


@dataclass(frozen=True)
class Content:
    """What fills the page."""

    values: Mapping[str, str]  # numbers by name
    tables: Mapping[str, Table]
    figures: Mapping[str, str]  # SVG by name
    warnings: Sequence[str]


def read_blocks(text: str | None = None) -> list[Block]:
    """The blocks of `page.md`, or of another text."""
    blocks = []
    for part in re.split(r"\n\s*\n", (TEXT.read_text() if text is None else text).strip()):
        comment, end, rest = part.partition("-->")
        said = comment.removeprefix("<!--").split(";") if end else ()
        pairs = (pair.partition("=") for pair in said)
        blocks.append(Block((rest if end else part).strip(), {name.strip(): v.strip() for name, _, v in pairs}))
    return blocks


def to_page(blocks: Sequence[Block], content: Content) -> str:
    """One HTML page: no script, no other file, readable on light and dark screens and on paper."""
    heads = [block.text.removeprefix("## ") for block in blocks if block.text.startswith("## ")]
    first = next(i for i, block in enumerate(blocks) if block.text.startswith("## "))
    return Template(SHELL.read_text()).substitute(
        title=escape(blocks[0].text.removeprefix("# ")),
        warnings="\n".join(f"<p class='warning'>{escape(warning)}</p>" for warning in content.warnings),
        lead="\n".join(_html(block, content) for block in blocks[1:first]),
        anchors="".join(f"<a href='#{_anchor(head)}'>{escape(head)}</a>" for head in heads),
        body=_body(blocks[first:], content),
    )


def _body(blocks: Sequence[Block], content: Content) -> str:
    parts = []
    for listed, group in groupby(blocks, lambda block: block.text.startswith("- ")):
        found = "\n".join(_html(block, content) for block in group)
        parts.append(f"<ul>\n{found}\n</ul>" if listed else found)
    return "\n".join(parts)


def _html(block: Block, content: Content) -> str:
    if found := TABLE.fullmatch(block.text):
        return to_html(content.tables[found[1]]) if found[1] in content.tables else f"<p class='note'>{NO_TABLE}</p>"
    if picture := PICTURE.fullmatch(block.text):
        return _picture(content.figures.get(picture[2]), escape(picture[1], quote=True))
    text = block.filled(content.values)
    if text.startswith("## "):
        return f"<h2 id='{_anchor(text[3:])}'>{escape(text[3:])}</h2>"
    if text.startswith("- "):
        return f"<li>{_inline(text[2:])}</li>"
    if text.startswith("*") and not text.startswith("**"):
        return f"<p class='note'>{_inline(text.strip('*'))}</p>"
    return f"<p>{_inline(text)}</p>"


def _picture(svg: str | None, caption: str) -> str:
    if svg is None:
        return f"<p class='note'>{NOT_DRAWN} {caption}</p>"
    data = base64.b64encode(svg.encode()).decode()
    image = f"<img alt='{caption}' src='data:image/svg+xml;base64,{data}'>"
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def _anchor(head: str) -> str:
    return re.sub(r"\W+", "-", head.lower()).strip("-")


def _inline(text: str) -> str:
    """Text between back quotes is code, between two stars bold."""
    return re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text)))


def to_text(blocks: Sequence[Block], content: Content) -> str:
    """The same as Markdown; figures are links into the folder `figures`."""
    title, *rest = (_text(block, content) for block in blocks)
    return "\n\n".join([title, *(f"> {warning}" for warning in content.warnings), *rest]) + "\n"


def _text(block: Block, content: Content) -> str:
    if found := TABLE.fullmatch(block.text):
        return to_markdown(content.tables[found[1]]).rstrip() if found[1] in content.tables else f"*{NO_TABLE}*"
    if picture := PICTURE.fullmatch(block.text):
        return f"{block.text}\n\n*{picture[1]}*" if picture[2] in content.figures else f"*{NOT_DRAWN} {picture[1]}*"
    return block.filled(content.values)
