"""The pages of the documentation as tests read them: links, anchors, blocks of code, commands."""

import re
import shlex
from pathlib import Path

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [README, ROOT / "benchmark" / "README.md", *DOCS]

_FENCE = re.compile(r"^(`{3,})([^\n`]*)\n(.*?)^\1 *$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(([^()\s]+)\)")
#: Blocks in which commands may stand, by what follows the fence.
_COMMANDS_IN = ("", "sh", "bash", "console")
#: What comes before a command: the prompt of a machine, variables, another user.
_BEFORE = re.compile(r"\w+=\S*$")
_ENDS = ("|", ">", "<", "&&", ";", "&")


def name_of(page):
    return page.relative_to(ROOT).as_posix()


def text_of(page):
    return page.read_text(encoding="utf-8")


def prose_of(page):
    """Return a page without its blocks of code."""
    return _FENCE.sub("", text_of(page))


def blocks_of(page, language):
    """Return the blocks of one language."""
    return [code for _, kind, code in _FENCE.findall(text_of(page)) if kind.strip() == language]


def links_of(page):
    """Return where the links of a page lead, inside the project."""
    text = re.sub(r"`[^`\n]*`", "", prose_of(page))
    return [link for link in _LINK.findall(text) if not re.match(r"[a-z]+:", link)]


def anchors_of(page):
    """Return the anchors of the headings of a page, as GitHub and the site make them."""
    found = {}
    for title in re.findall(r"^#{1,6} (.+)$", prose_of(page), re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title.strip().replace("\\", ""))
        slug = re.sub(r"[^\w\- ]", "", plain.lower()).replace(" ", "-")
        found[slug] = found.get(slug, 0) + 1
    return {f"{slug}-{n}" if n else slug for slug, count in found.items() for n in range(count)}


def commands_of(page, program="coastarc"):
    """Return the commands of one program in the blocks of a page, each as its words after the program."""
    lines = "\n".join(block for kind in _COMMANDS_IN for block in blocks_of(page, kind))
    lines += "\n" + "\n".join(re.findall(r"^    (.+)$", prose_of(page), re.MULTILINE))
    found = []
    for line in lines.replace("\\\n", " ").splitlines():
        if re.search(rf"(^|[ /]){program} ", line):
            found.extend(_commands_in(line, program))
    return found


def _commands_in(line, program):
    try:
        words = shlex.split(re.sub(r"\$\([^)]*\)", "WORD", line), comments=True)
    except ValueError:
        return []
    words = words[words.index("&&") + 1 :] if "&&" in words[: _place(words, program)] else words
    if words[:2] == ["sudo", "-u"]:
        words = words[3:]
    while words and (words[0].endswith("$") or _BEFORE.match(words[0])):
        words = words[1:]
    if not words or Path(words[0]).name != program:
        return []
    ends = [place for place, word in enumerate(words) if word in _ENDS]
    return [words[1 : min(ends, default=len(words))]]


def _place(words, program):
    return next((place for place, word in enumerate(words) if Path(word).name == program), 0)


def inline_commands_of(page, program="coastarc"):
    """Return the commands that stand in the sentences and tables of a page."""
    found = re.findall(rf"`{program} ([^`]*)`", prose_of(page))
    return [re.sub(r"\s+", " ", command.replace("\\|", "|")).split() for command in found]
