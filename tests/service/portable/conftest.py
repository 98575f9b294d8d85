"""Fixtures of this folder."""

from tests.service.portable.made import certified, files, origin  # noqa: F401 - fixtures
