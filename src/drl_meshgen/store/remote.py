"""Where artifacts are copied to and from: a folder, or with fsspec whatever a URL names."""

import re
import shutil
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any, Protocol

from drl_meshgen.errors import InputError
from drl_meshgen.store.locks import shared
from drl_meshgen.store.objects import settle
from drl_meshgen.store.store import Store

_NAME = re.compile(r"records/[a-z][a-z0-9_-]{0,63}/[0-9a-f]{64}\.json|objects/([0-9a-f]{2})/\1[0-9a-f]{62}")


class Remote(Protocol):
    """Files of a store somewhere else, by their names below its folder."""

    def sizes(self) -> dict[str, int]:
        """Return the bytes of every file that is named as a store names files; others are passed over."""
        ...

    def fetch(self, name: str, target: Path) -> None:
        """Copy a file here; raises OSError where that fails."""
        ...

    def send(self, source: Path, name: str) -> None:
        """Copy a file there, which appears whole; raises OSError where that fails."""
        ...

    def at_work(self) -> AbstractContextManager[None]:
        """Keep what was sent from being tidied away before its record is there."""
        ...


def remote_at(place: str) -> Remote:
    """Return the remote that a folder or a URL (`s3://bucket/prefix`) names.

    Raises `InputError` where the packages for such a URL are not installed.
    """
    if "://" not in place:
        return FolderRemote(Path(place))
    scheme = place.partition("://")[0]
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        raise InputError(place, "URLs need the package fsspec", "install it, or name a folder") from None
    try:
        system, root = url_to_fs(place)
    except ImportError as error:
        raise InputError(place, f"{scheme}:// needs a package that is not installed ({error})") from None
    except ValueError as error:
        raise InputError(place, f"{scheme}:// is not known ({error})") from None
    return UrlRemote(place, system, root)


class FolderRemote:
    """A store in a folder."""

    def __init__(self, root: Path) -> None:
        self._store = Store(root)

    def sizes(self) -> dict[str, int]:
        """Return the bytes of every file of the store."""
        files = (path for pattern in ("records/*/*", "objects/*/*") for path in sorted(self._store.root.glob(pattern)))
        sizes = {path.relative_to(self._store.root).as_posix(): path.stat().st_size for path in files if path.is_file()}
        return {name: size for name, size in sizes.items() if _NAME.fullmatch(name)}

    def fetch(self, name: str, target: Path) -> None:
        """Copy a file here."""
        shutil.copyfile(self._store.root / name, target)

    def send(self, source: Path, name: str) -> None:
        """Copy a file there."""
        with self._store.scratch() as folder:
            draft = folder / "draft"
            shutil.copyfile(source, draft)
            settle(draft, self._store.root / name)

    def at_work(self) -> AbstractContextManager[None]:
        """Share the lock of the store."""
        return shared(self._store.guard)


class UrlRemote:
    """A store in a file system of fsspec."""

    def __init__(self, place: str, system: Any, root: str) -> None:
        self._place, self._system, self._root = place, system, root.rstrip("/")

    @contextmanager
    def _asked(self) -> Iterator[None]:
        """Turn into OSError what fails at the other side: each back end of fsspec has errors of its own libraries."""
        try:
            yield
        except Exception as error:
            raise OSError(f"{self._place}: {error}") from error

    def sizes(self) -> dict[str, int]:
        """Return the bytes of every file of the store."""
        with self._asked():
            return dict(self._sizes())

    def _sizes(self) -> Iterator[tuple[str, int]]:
        for folder in ("records", "objects"):
            found = self._system.find(f"{self._root}/{folder}", detail=True)
            for path in sorted(found):
                name = folder + path.rpartition(f"/{folder}")[2]
                if _NAME.fullmatch(name):
                    yield name, int(found[path]["size"])

    def fetch(self, name: str, target: Path) -> None:
        """Copy a file here."""
        with self._asked():
            self._system.get_file(f"{self._root}/{name}", str(target))

    def send(self, source: Path, name: str) -> None:
        """Copy a file there; buckets show it only when it is whole."""
        path = f"{self._root}/{name}"
        with self._asked():
            self._system.makedirs(path.rpartition("/")[0], exist_ok=True)
            self._system.put_file(str(source), path)

    def at_work(self) -> AbstractContextManager[None]:
        """Do nothing: nobody tidies up there."""
        return nullcontext()
