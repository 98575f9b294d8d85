"""What a user typed wrongly, as one line like every other error; and the order of commands in the help."""

import re

from typer import TyperException
from typer.core import TyperGroup

#: As a newcomer needs them; what is not named here comes before the last four.
FIRST = "run serve submit dispatch status watch pause resume cancel share solutions seeds report".split()
LAST = "bench db token doctor".split()

#: What the parser says, and how we say it.
_SAYINGS = (
    (
        r"Invalid value for '([^']+)': Value error, (.+) is not one of (.+?)\.?",
        r"\1: expected one of \3, got \2",
    ),
    (r"Invalid value for '([^']+)': Input should be (.+?)(?:, unable to .*)?", r"\1: expected \2"),
    (r"Invalid value for '([^']+)': (.+)", r"\1: \2"),
    (r"Missing (?:option|argument) '([^']+)'.*", r"\1: expected a value, got none"),
    (
        r"No such (command|option):? ('?.+?'?)\.? Did you mean (.*)\?",
        r"\1: expected one that exists, got \2; did you mean \3",
    ),
    (r"No such command ('.*?')\.?(.*)", r"command: expected one that exists, got \1\2"),
    (r"No such option: (\S+)(.*)", r"option: expected one that exists, got \1\2"),
    (r"Got unexpected extra argument(?:s|\(s\))? \((.*)\)", r"arguments: expected no more, got \1"),
)


class InOrder(TyperGroup):
    """Lists commands as they are needed, and not as they are registered."""

    def list_commands(self, ctx: object) -> list[str]:
        """Return the names of the commands in the order of the help."""
        others = [name for name in self.commands if name not in {*FIRST, *LAST}]
        return [name for name in (*FIRST, *others, *LAST) if name in self.commands]


def fault_line(error: TyperException) -> str:
    """Return what is wrong with a command in one line; nothing where the help was the answer."""
    if type(error).__name__ == "NoArgsIsHelpError":
        return ""
    text = " ".join(error.format_message().split())
    for pattern, form in _SAYINGS:
        match = re.fullmatch(pattern, text)
        if match:
            text = match.expand(form).strip()
            break
    context = getattr(error, "ctx", None)
    return f"{text}; see `{context.command_path} --help`" if context else text
