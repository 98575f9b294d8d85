"""What is wrong with a portable file, or with making one."""

from core.faults import UserError


class PortableError(UserError, RuntimeError):
    """A portable file that cannot be made, or that is refused; nothing has changed then."""
