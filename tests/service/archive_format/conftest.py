"""Fixtures of this folder."""

from tests.service.archive_format.made import certified, files, origin  # noqa: F401 - fixtures
