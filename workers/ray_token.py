"""The secret of a Ray cluster: whoever has it can run anything on its machines.

Ray itself writes its token readable for all users, so the file is ours and its mode is checked.
"""

import os
import secrets
import stat
from collections.abc import MutableMapping
from pathlib import Path

from platformdirs import user_data_path

from workers.executor import ExecutorError


def own_token(path: Path | None = None) -> Path:
    """Return the file with the token of clusters started here; it is made where there is none."""
    path = path or user_data_path("coastarc") / "ray.token"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        draft = path.with_name(f"{path.name}.{os.getpid()}")
        with open(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(secrets.token_hex(32))
        try:
            # Unlike a rename, a link never replaces the token that another process wrote meanwhile.
            os.link(draft, path)
        except FileExistsError:
            pass
        finally:
            draft.unlink()
    return checked(path)


def checked(path: Path) -> Path:
    """Return a token file that nobody else can read."""
    if not path.is_file():
        raise ExecutorError(f"ray token: expected a file with the cluster's token, got {path}")
    mode = stat.S_IMODE(path.stat().st_mode)
    if mode & 0o077:
        raise ExecutorError(f"ray token {path}: expected mode 0600, got {mode:04o}; chmod 600 it")
    return path


def require_token(environment: MutableMapping[str, str], path: Path | None) -> None:
    """Set what makes Ray authenticate; read when Ray is imported and handed on to what it starts."""
    environment["RAY_AUTH_MODE"] = "token"
    if path is not None:
        # A token in the environment would win over the file.
        environment.pop("RAY_AUTH_TOKEN", None)
        # Absolute, since Ray's processes stand elsewhere.
        environment["RAY_AUTH_TOKEN_PATH"] = str(path.absolute())
