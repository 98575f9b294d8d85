"""Where an archive is: a file in the data folder, or the PostgreSQL database of a URL."""

import os
from pathlib import Path

from sqlalchemy import URL, make_url
from sqlalchemy.exc import ArgumentError

from core.text import read_text
from service.db.errors import DatabaseError, unusable

FILE_NAME = "coastarc.db"
#: The URL itself, or the file that holds it, as secrets are mounted in containers.
URL_VARIABLE = "COASTARC_DATABASE_URL"
DRIVER = "postgresql+psycopg"

#: An SQLite file, or a PostgreSQL database.
Place = Path | URL


def make_folder(folder: Path) -> None:
    """Make a data folder where there is none."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise unusable(folder, error.strerror) from error


def place_of(folder: Path) -> Place:
    """Return where the archive of a data folder is: in it, unless the environment names a database."""
    url = os.environ.get(URL_VARIABLE)
    if path := os.environ.get(f"{URL_VARIABLE}_FILE"):
        try:
            url = read_text(Path(path)).strip()
        except (OSError, ValueError) as error:
            raise DatabaseError(f"{URL_VARIABLE}_FILE: expected a file to read, got {error}") from error
    return folder / FILE_NAME if not url else database_url(url)


def database_url(text: str) -> URL:
    """Return the URL of a PostgreSQL database; the text may hold a password and is never repeated."""
    expected = f"{URL_VARIABLE}: expected {DRIVER}://USER@HOST/DATABASE"
    try:
        url = make_url(text)
    except (ArgumentError, ValueError):
        raise DatabaseError(f"{expected}, got no URL") from None
    if url.drivername in ("postgresql", "postgres"):
        url = url.set(drivername=DRIVER)
    if url.drivername != DRIVER:
        raise DatabaseError(f"{expected}, got one of {url.drivername}; SQLite archives are named by --data")
    if not url.database:
        raise DatabaseError(f"{expected}, got none of a database")
    return url


def shown(place: Place) -> str:
    """Return a place as users may read it, without a password."""
    return str(place) if isinstance(place, Path) else place.render_as_string(hide_password=True)
