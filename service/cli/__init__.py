"""The command line: what a user types in, calls of the service or of a coordinator's API out.

`command` puts the commands together, one file for each command or group of commands; `terminal` draws their
tables.
"""

from service.cli.command import app_of, main

__all__ = ["app_of", "main"]
