"""What is wrong with a portable file, or with making one."""

from core.faults import UserError


class PortableError(UserError, RuntimeError):
    """A portable file that cannot be made, or that is refused; nothing has changed then."""


class PortableConflict(PortableError):
    """What stands in the archive is against it: a campaign at work, or the same one with other work."""
