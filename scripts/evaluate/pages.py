"""Figures on pages, and the records that they come from.

A table between `<!-- table: NAME -->` and `<!-- end -->` is written by tables.py. The comment
`<!-- measured: PATH PATH:FORMAT ... -->` ends a paragraph or an item of a list and names its figures in the order in
which they stand there. A path leads into a record: `accuracy.large.real.found`; PATH/PATH is a ratio. A format is the
digits after the point (`:1`), or `:w` for a word ("three"). The comment `<!-- given: WHY -->` ends a paragraph whose
figures are of no record, and says why.
"""

import json
import os
import re

from places import DOCS, INSTRUCTIONS, ROOT
from record import read_record
from tables import TABLES, absent, counts

# Pages with figures. On the first, each paragraph with a figure must say where it comes from.
WHOLE = (os.path.join(DOCS, "measured.md"),)
PAGES = (
    *WHOLE,
    os.path.join(ROOT, "README.md"),
    os.path.join(ROOT, "bindings", "web", "README.md"),
    *(os.path.join(DOCS, f"{page}.md") for page in ("at-scale", "camera", "space", "tutorials/gallery")),
)
WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
TABLE = re.compile(r"<!-- table: ([\w-]+) -->\n(.*?)<!-- end -->", re.S)
COMMENT = re.compile(r"<!-- (measured|given): (.*?) -->", re.S)


def update():
    """Writes the tables of all pages; gives what is wrong with their other figures."""
    return review(write=True)


def check():
    """What is wrong with the figures of all pages."""
    return review(write=False)


def review(write):
    """What is wrong with the figures of all pages, after their tables were written if `write` says so."""
    wrong = []
    for path in PAGES:
        where = os.path.relpath(path, ROOT)
        with open(path, encoding="utf-8") as f:
            old = f.read()
        new, lacking = with_tables(old)
        wrong += [f"{where}: {lack}" for lack in lacking]
        if new != old and write:
            with open(path, "w", encoding="utf-8") as f:
                f.write(new)
            print(f"wrote {where}", flush=True)
        elif new != old:
            wrong.append(f"{where}: a table is not that of its record; scripts/measure --pages writes it")
        wrong += problems(path, new)
    return wrong


def with_tables(text):
    """The page with its tables as the records have them, and what the records lack; such a table stays as it is."""
    lacking = []

    def table(match):
        try:
            return f"<!-- table: {match[1]} -->\n" + "\n".join(TABLES[match[1]]()) + "\n<!-- end -->"
        except (KeyError, FileNotFoundError) as error:
            lacking.append(f"the table {match[1]} cannot be made: {error} is in no record")
            return match[0]

    return TABLE.sub(table, text), lacking


def problems(path, text):
    """What is wrong with the figures of a page outside of its tables."""
    where, wrong = os.path.relpath(path, ROOT), []
    for line, paragraph in paragraphs(TABLE.sub(lambda m: "\n" * m[0].count("\n"), text)):
        comments = COMMENT.findall(paragraph)
        words = COMMENT.sub("", paragraph)
        for kind, what in comments:
            if kind == "measured":
                wrong += [f"{where}, line {line}: {w}" for w in compare(words, what.split())]
        if path in WHOLE and not comments and re.search(r"\d", plain(words)):
            wrong.append(f"{where}, line {line}: the figures come from nowhere: {words.strip()[:60]}")
    return wrong


def compare(words, places):
    """Looks for the values of `places` in the paragraph, in this order; gives what is missing."""
    at, wrong = 0, []
    for place in places:
        try:
            value = formatted(place)
        except (KeyError, FileNotFoundError) as error:
            wrong.append(f"{place} is in no record: {error}")
            continue
        found = re.compile(rf"(?<![\w.,]){re.escape(value)}(?![\w]|[.,]\d)", re.I).search(words, at)
        if found:
            at = found.end()
        else:
            wrong.append(f'"{value}" ({place}) does not stand there, or not in this order')
    return wrong


def formatted(place):
    """The value at a place of the records, as it stands on a page."""
    path, _, form = place.partition(":")
    over, _, under = path.partition("/")
    value = value_of(over.split("."))
    if under:
        value /= value_of(under.split("."))
    if form == "w":
        return WORDS[round(value)] if round(value) < len(WORDS) else f"{round(value):,}"
    if form:
        return f"{value:,.{int(form)}f}"
    return f"{value:,}" if isinstance(value, int) else f"{value}"


def value_of(keys):
    """The value at a path.

    Of accuracy METHOD.KIND.KEY, METHOD.KIND.GROUP.KEY or METHOD.absent.KEY; `instructions` of a search are millions.
    """
    if keys[0] == "instructions":
        with open(INSTRUCTIONS, encoding="utf-8") as f:
            return json.load(f)["total"] / 1e6
    if keys[0] != "accuracy":
        value = read_record(keys[0])
        for key in keys[1:]:
            # A name with spaces is written with lines: Keygraph_large.
            if isinstance(value, list):
                value = value[int(key)]
            else:
                value = value[key if key in value else key.replace("_", " ")]
        return value
    _, method, kind, *names, key = keys
    if kind == "absent":
        frames, false = absent(method)
        return {"frames": frames, "false": false}[key]
    return counts(method, kind, names or None)[key]


def plain(text):
    """The text without code and without the targets of links."""
    return re.sub(r"`[^`]*`|\]\([^)]*\)", "", text)


def paragraphs(text):
    """Paragraphs, items of lists and tables of a page outside of code: the number of the first line, and the text."""
    out, code, start, lines = [], False, 0, []

    def end():
        if lines:
            out.append((start, "\n".join(lines)))
            lines.clear()

    for number, line in enumerate(text.split("\n"), 1):
        if line.lstrip().startswith("```"):
            end()
            code = not code
            continue
        if code or not line.strip() or line.startswith(("#", "![")):
            end()
            continue
        if re.match(r"\s*[-*] ", line):
            end()
        if not lines:
            start = number
        lines.append(line)
    end()
    return out
