"""A table once, written as HTML, Markdown and CSV."""

import csv
import io
import math
from dataclasses import dataclass
from html import escape


@dataclass(frozen=True)
class Number:
    """A measured value with its interval. NaN where there is none."""

    mean: float
    low: float = math.nan
    high: float = math.nan
    digits: int = 2

    @property
    def value(self) -> str:
        """The value alone; a dash where there is none."""
        return "-" if math.isnan(self.mean) else f"{self.mean:.{self.digits}f}"

    @property
    def interval(self) -> str:
        """The interval alone, "" where there is none."""
        if math.isnan(self.low) or math.isnan(self.high):
            return ""
        return f"{self.low:.{self.digits}f} to {self.high:.{self.digits}f}"

    @property
    def text(self) -> str:
        """The value and, in brackets, its interval."""
        return f"{self.value} ({self.interval})" if self.interval else self.value


Entry = str | Number
SHORT = 28  # characters; text up to this is not broken into lines


@dataclass(frozen=True)
class Table:
    """Rows of text and numbers."""

    name: str  # of its CSV file
    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[Entry, ...], ...]
    note: str = ""


def to_markdown(table: Table) -> str:
    """A pipe table under its title, the note below."""
    lines = [table.header, ("---",) * len(table.header), *(tuple(map(_text, row)) for row in table.rows)]
    body = "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
    return f"**{table.title}**\n\n{body}\n" + (f"\n{table.note}\n" if table.note else "")


def to_html(table: Table) -> str:
    """A figure that scrolls sideways where the page is narrow."""
    head = "".join(f"<th scope='col'>{escape(title)}</th>" for title in table.header)
    rows = "\n".join(f"<tr>{''.join(map(_html_cell, row))}</tr>" for row in table.rows)
    note = f"<p class='note'>{escape(table.note)}</p>" if table.note else ""
    return (
        f"<figure class='table'><figcaption>{escape(table.title)}</figcaption><div class='scroll'><table>\n"
        f"<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody></table></div>{note}</figure>"
    )


def to_csv(table: Table) -> str:
    """Plain numbers; a column that has intervals becomes three, the next two its `low` and `high`."""
    columns = [_csv_column(title, [row[i] for row in table.rows]) for i, title in enumerate(table.header)]
    buffer = io.StringIO()
    rows = zip(*(column for group in columns for column in group), strict=True)
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def _csv_column(title: str, entries: list[Entry]) -> list[list[str]]:
    """One column, title first, or three."""
    numbers = [entry if isinstance(entry, Number) else None for entry in entries]
    plain = [entry if isinstance(entry, str) else _plain(entry.mean) for entry in entries]
    if not any(number and number.interval for number in numbers):
        return [[title, *plain]]
    low, high = ([_plain(getattr(n, side)) if n else "" for n in numbers] for side in ("low", "high"))
    return [[title, *plain], [f"{title} low", *low], [f"{title} high", *high]]


def _plain(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6g}"


def _text(entry: Entry) -> str:
    return entry if isinstance(entry, str) else entry.text


def _html_cell(entry: Entry) -> str:
    if isinstance(entry, str):
        return f"<td{' class=short' * (len(entry) <= SHORT)}>{escape(entry)}</td>"
    interval = f" <small>{escape(entry.interval)}</small>" if entry.interval else ""
    return f"<td class='number'>{entry.value}{interval}</td>"
