"""Content-addressed files: the name is the SHA-256 of the content, so damage shows."""

import errno
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from drl_meshgen.store.canonical import file_digest
from drl_meshgen.store.ref import DIGEST, checked_digest


def sync(path: Path) -> None:
    """Force a file or folder to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def settle(source: Path, target: Path) -> None:
    """Give a finished file its final name atomically: it exists whole on the disk or not at all.

    `source` must lie in the same file system; afterwards it is gone and `target` is read-only.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    source.chmod(0o444)
    sync(source)
    if target.is_dir() and not target.is_symlink():  # not of the store's making
        target.rmdir()
    source.replace(target)
    sync(target.parent)


class Objects:
    """The files `ab/<sha256>` below a folder."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def path(self, sha: str) -> Path:
        """Return the place of an object; raises ValueError where `sha` is not a digest."""
        return self.root / checked_digest(sha)[:2] / sha

    def files(self) -> Iterator[Path]:
        """Yield the files that are named like objects, in order, whatever they hold."""
        for path in sorted(self.root.glob("??/*")):
            if DIGEST.fullmatch(path.name) and path.parent.name == path.name[:2] and path.is_file():
                yield path

    def put(self, file: Path) -> str:
        """Move a file in and return its digest. A damaged object of the same name is replaced."""
        sha = file_digest(file)
        settle(file, self.path(sha))
        return sha

    def intact(self, sha: str) -> bool:
        """Tell whether the object is there with the content its name promises."""
        path = self.path(sha)
        try:
            return path.is_file() and file_digest(path) == sha
        except OSError as error:
            if error.errno in (errno.ENOENT, errno.EIO):  # removed meanwhile, unreadable sector
                return False
            raise

    def give(self, sha: str, target: Path) -> bool:
        """Put an object at `target` (a link where the file system allows) and tell whether it is intact."""
        if not self.path(sha).is_file():  # opening a pipe would wait for ever
            return False
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            target.hardlink_to(self.path(sha))
        except FileNotFoundError:
            return False
        except OSError:
            shutil.copyfile(self.path(sha), target)
        return file_digest(target) == sha
