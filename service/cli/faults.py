"""What a user typed wrongly, as one line like every other error."""

import re

from rich.console import Console
from rich.text import Text
from typer import TyperException

errors = Console(stderr=True)

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


def complain(message: str) -> None:
    """Print an error in one line."""
    # As text: what users typed may look like markup.
    errors.print(Text.assemble(("error: ", "red"), message), soft_wrap=True)


def warn(message: str) -> None:
    """Print in one line what is not as it should be, and stops nothing."""
    errors.print(Text.assemble(("warning: ", "yellow"), message), soft_wrap=True)


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
