"""Writing a campaign of an archive to a portable file, and taking one in."""

import re
import tempfile
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import BinaryIO

from service.archive_format.container import Unpacked, pack
from service.archive_format.reading import read_all, unpack_targets
from service.store.archive_io import ImportResult
from service.store.store import Store

_PIECE = 2**20
#: A file that is refused takes the kernels it brought away again: no other may have begun to use them.
_one_at_a_time = threading.Lock()


def packed(store: Store, campaign_id: int, folder: Path | None = None) -> BinaryIO:
    """Return the portable file of a campaign, without a name in any folder; it is gone when it is closed."""
    draft = tempfile.TemporaryFile(dir=folder)
    try:
        store.write_portable(campaign_id, lambda campaign, entries: pack(draft, campaign, entries))
    except BaseException:
        draft.close()
        raise
    draft.seek(0)
    return draft


def pieces(stream: BinaryIO) -> Iterator[bytes]:
    """Return the content of a file piece by piece."""
    return iter(lambda: stream.read(_PIECE), b"")


def portable(store: Store, campaign_id: int) -> Iterator[bytes]:
    """Yield the portable file of a campaign piece by piece."""
    with closing(packed(store, campaign_id)) as draft:
        yield from pieces(draft)


def file_name(name: str) -> str:
    """Return what the portable file of a campaign is called."""
    return f"campaign-{re.sub('[^A-Za-z0-9._-]+', '-', name).strip('-.') or 'file'}.zip"


def import_file(store: Store, file: Path | BinaryIO, name: str | None = None) -> ImportResult:
    """Take in a portable file whole, or change nothing; `name` is what errors call it."""
    with _one_at_a_time, Unpacked(file, name) as unpacked:
        new: list[Path] = []
        try:
            new.extend(unpack_targets(unpacked, store.folder))
            return store.import_campaigns(read_all(unpacked, store.folder))
        except BaseException:
            for path in new:
                path.unlink(missing_ok=True)
            raise
