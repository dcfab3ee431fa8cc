"""A report of headed sections, written as one HTML page that needs nothing else, or as Markdown."""

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from experiments.table import Table, to_html, to_markdown


@dataclass(frozen=True)
class Picture:
    """A figure as SVG text."""

    name: str  # of its file
    caption: str
    svg: str


@dataclass(frozen=True)
class Point:
    """A claim in bold and what is behind it."""

    head: str
    text: str


@dataclass(frozen=True)
class Section:
    """Text, points, figures, tables, in this order."""

    title: str
    paragraphs: tuple[str, ...] = ()
    points: tuple[Point, ...] = ()
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()


@dataclass(frozen=True)
class Report:
    """The whole."""

    title: str
    lead: tuple[Point, ...]  # what to know when one reads no further
    warnings: tuple[str, ...]
    sections: tuple[Section, ...]


STYLE = """
:root { color-scheme: light dark; --ink: #1c1c1c; --paper: #ffffff; --quiet: #5c5c5c; --line: #d9d9d9; --card: #f4f6f8;
  --alarm: #fff3d6; }
@media (prefers-color-scheme: dark) { :root { --ink: #e8e8e8; --paper: #16181b; --quiet: #a5a9ae; --line: #3a3e44;
  --card: #202429; --alarm: #4a3a10; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.5rem 1.2rem 4rem; max-width: 80rem; color: var(--ink); background: var(--paper);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0.5rem 0 1rem; }
h2 { font-size: 1.35rem; margin: 3rem 0 0.8rem; padding-top: 0.6rem; border-top: 1px solid var(--line); }
p, li { max-width: 48rem; }
ul { padding-left: 1.2rem; }
li { margin-bottom: 0.6rem; }
.lead { background: var(--card); border-radius: 8px; padding: 0.8rem 1.2rem; }
.lead p { margin: 0.6rem 0; max-width: none; }
.warning { background: var(--alarm); border-radius: 8px; padding: 0.6rem 1.2rem; max-width: none; }
nav a { margin-right: 1rem; color: inherit; }
figure { margin: 1.5rem 0; }
figure img { width: 100%; height: auto; background: #ffffff; border-radius: 8px; padding: 8px; display: block; }
figcaption { color: var(--quiet); font-size: 0.92rem; margin-top: 0.4rem; max-width: 60rem; }
.table figcaption { color: var(--ink); font-weight: 600; font-size: 1rem; margin-bottom: 0.4rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.82rem; font-variant-numeric: tabular-nums; }
th, td { padding: 0.26rem 0.45rem; text-align: left; border-bottom: 1px solid var(--line); vertical-align: top; }
th { border-bottom: 2px solid var(--quiet); font-weight: 600; min-width: 3.6rem; }
td.number, td.short { white-space: nowrap; }
small, .note { color: var(--quiet); }
.note { font-size: 0.88rem; max-width: 60rem; }
@media print { body { max-width: none; padding: 0; font-size: 10pt; } nav { display: none; }
  figure, tr { break-inside: avoid; } h2 { break-after: avoid; } .scroll { overflow: visible; }
  table { font-size: 7pt; } th, td { padding: 0.15rem 0.25rem; min-width: 0; }
  td.number, td.short { white-space: normal; } }
"""


def report_html(report: Report) -> str:
    """One page: no script, no other file, readable on light and dark screens and on paper."""
    anchors = "".join(f"<a href='#s{i}'>{escape(s.title)}</a>" for i, s in enumerate(report.sections))
    warnings = "".join(f"<p class='warning'>{escape(warning)}</p>" for warning in report.warnings)
    lead = "".join(f"<p><strong>{escape(p.head)}</strong> {escape(p.text)}</p>" for p in report.lead)
    body = "\n".join(_section_html(section, i) for i, section in enumerate(report.sections))
    return (
        "<!DOCTYPE html>\n<html lang='en'>\n<head>\n<meta charset='utf-8'>\n"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>\n"
        f"<title>{escape(report.title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{escape(report.title)}</h1>\n"
        f"{warnings}\n<div class='lead'>{lead}</div>\n<nav><p>{anchors}</p></nav>\n{body}\n</body>\n</html>\n"
    )


def _section_html(section: Section, number: int) -> str:
    points = "".join(f"<li><strong>{escape(p.head)}</strong> {escape(p.text)}</li>\n" for p in section.points)
    parts = [
        f"<h2 id='s{number}'>{escape(section.title)}</h2>",
        *(f"<p>{_with_code(paragraph)}</p>" for paragraph in section.paragraphs),
        f"<ul>\n{points}</ul>" if points else "",
        *(_picture_html(picture) for picture in section.pictures),
        *(to_html(table) for table in section.tables),
    ]
    return "\n".join(part for part in parts if part)


def _with_code(text: str) -> str:
    """Text between back quotes is code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def _picture_html(picture: Picture) -> str:
    data = base64.b64encode(picture.svg.encode()).decode()
    caption = escape(picture.caption, quote=True)
    image = f"<img alt='{caption}' src='data:image/svg+xml;base64,{data}'>"
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def report_markdown(report: Report, figures: str) -> str:
    """The same as Markdown; figures are links into the folder `figures`."""
    lines = [f"# {report.title}", *(f"> {warning}" for warning in report.warnings)]
    lines += [f"**{point.head}** {point.text}" for point in report.lead]
    for section in report.sections:
        lines += [f"## {section.title}", *section.paragraphs, *_points_markdown(section.points)]
        lines += [f"![{p.caption}]({figures}/{p.name}.svg)\n\n*{p.caption}*" for p in section.pictures]
        lines += [to_markdown(table).rstrip() for table in section.tables]
    return "\n\n".join(lines) + "\n"


def _points_markdown(points: Sequence[Point]) -> list[str]:
    return ["\n".join(f"- **{point.head}** {point.text}" for point in points)] if points else []
