"""What is wrong with a portable file, or with making one."""

from typing import Any

from pydantic import ValidationError

from core.faults import UserError, fault_lines

#: Faults of one line of a file that are looked through for the first that explains the others.  A list of
#: two million things that are no numbers is 20 kB in a file, and its faults are 2 GiB.
MOST_FAULTS = 1000


class PortableError(UserError, RuntimeError):
    """A portable file that cannot be made, or that is refused; nothing has changed then."""


class PortableConflict(PortableError):
    """What stands in the archive is against it: a campaign at work, or the same one with other work."""


def first_fault(thing: str, error: ValidationError, kind: Any) -> str:
    """Return what is wrong with data of a model, in one line."""
    if (n := error.error_count()) > MOST_FAULTS:
        return f"{thing}: expected {kind.__name__}, got {n} faults"
    (first, *_) = fault_lines(thing, error.errors(include_url=False), kind)
    return first
