"""Locks between threads and processes that share a store; the kernel lets go of them when their holder dies."""

import atexit
import errno
import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import IO

_READ_ONLY = (errno.EROFS, errno.EACCES, errno.EPERM)


def refused(error: OSError) -> bool:
    """Tell whether a store refuses to be written to: it is mounted read-only or belongs to somebody else."""
    return error.errno in _READ_ONLY


@contextmanager
def exclusive(path: Path) -> Iterator[None]:
    """Hold a lock file; others (threads and processes) wait.

    Whoever holds it may remove the file: those who waited then take the new one.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    while True:
        with path.open("a") as handle:
            fcntl.flock(handle, fcntl.LOCK_EX)
            if _is(handle, path):
                yield
                return


@contextmanager
def shared(path: Path) -> Iterator[None]:
    """Hold a lock file together with others who share it; whoever wants it for himself waits.

    Where neither file nor folder can be written, nobody can remove anything either, and nothing is held.
    """
    handle = _opened(path)
    if handle is None:
        yield
        return
    with handle:
        fcntl.flock(handle, fcntl.LOCK_SH)
        yield


@contextmanager
def idle(path: Path) -> Iterator[bool]:
    """Hold an existing lock file unless somebody else does, and tell which.

    A file that may not be opened belongs to another user, who is taken to hold it.
    """
    try:
        handle = path.open("r")
    except (FileNotFoundError, PermissionError):
        yield False
        return
    with handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            held = _is(handle, path)
        except BlockingIOError:
            held = False
        yield held


def present(folder: Path) -> str | None:
    """Show by a locked file in `folder` that this process uses a store from now on; return the end of its name.

    The file's time is when that began. None where the store refuses to be written to.
    """
    return _presence(folder.absolute(), os.getpid())


USER = "user-"
"""Start of the names of files that `present` makes."""


@cache
def _presence(folder: Path, process: int) -> str | None:
    while True:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(prefix=USER, dir=folder)  # stays locked until the process ends
        except OSError as error:
            if refused(error):
                return None
            raise
        fcntl.flock(handle, fcntl.LOCK_EX)
        if Path(name).exists():  # else somebody who tidied up came between
            break
        os.close(handle)
    atexit.register(_leave, Path(name), process)
    return Path(name).name.removeprefix(USER)


def _leave(path: Path, process: int) -> None:
    if os.getpid() == process:  # a forked child that ends is not the end of its parent
        path.unlink(missing_ok=True)


def _is(handle: IO[str], path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _opened(path: Path) -> IO[str] | None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return path.open("a")
    except OSError as error:
        if not refused(error):
            raise
    try:
        return path.open("r")
    except OSError:
        return None
