"""Writing a campaign of an archive to a portable file, and taking one in."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from service.portable.container import Unpacked, pack
from service.portable.reading import read_all
from service.portable.targets import unpack_targets
from service.store import Store
from service.store.portable_import import TakenIn

_PIECE = 2**20


@contextmanager
def written_pieces(store: Store, campaign_id: int) -> Iterator[Iterator[bytes]]:
    """Give the portable file of a campaign, piece by piece."""
    with tempfile.TemporaryFile() as draft:
        store.write_portable(campaign_id, lambda campaign, entries: pack(draft, campaign, entries))
        draft.seek(0)
        yield iter(lambda: draft.read(_PIECE), b"")


def take_in_file(store: Store, file: Path) -> TakenIn:
    """Take in a portable file whole, or change nothing."""
    with Unpacked(file) as unpacked:
        new: list[Path] = []
        try:
            new.extend(unpack_targets(unpacked, store.folder))
            return store.take_in(read_all(unpacked, store.folder))
        except BaseException:
            for path in new:
                path.unlink(missing_ok=True)
            raise
