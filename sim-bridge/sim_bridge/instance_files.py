"""Where an instance's files lie, whose they are, and the reservation of what they take.

As in the Rust package `tprmp-messages`, which says why.
"""

from __future__ import annotations

import fcntl
import os
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sim_bridge.errors import BridgeError

SHARED_MEMORY = Path("/dev/shm")
SHARED_MEMORY_MIN_BYTES = 4 << 20
"""Least free shared memory needed to open an instance."""

_FILES_MIN = 64
"""Least number of files that can still be created in it."""

_UNFINISHED = 0o200
"""Permissions of a file until iceoryx2 has initialised it."""

_LOCK_PAUSE_S = 0.005
_LOCK_TRIES_MAX = 2000


class Files:
    """The files of one instance."""

    def __init__(self, name: str) -> None:
        self.user = os.getuid()
        self.prefix = f"tprmp_{self.user}_{name}_"
        self._user_folder = Path(f"/tmp/tprmp-{self.user}")
        self.folder = self._user_folder / name

    def shared(self) -> list[Path]:
        """The files in shared memory."""
        return sorted(SHARED_MEMORY.glob(f"{self.prefix}*"))

    @contextmanager
    def claim(self) -> Iterator[None]:
        """Makes the folders, checks whose everything is, and keeps others out of the block.

        Raises `BridgeError` where a file is not this user's own.
        """
        with self._lock():
            os.close(self._claim_folder(self.folder))
            for path in self.folder.rglob("*"):
                self._check(path)
            for path in self.shared():
                mode = self._check(path)
                # Whoever is killed while creating one leaves it so, and iceoryx2 would wait for it.
                if mode == _UNFINISHED and path.suffix in (".global_mgmt", ".dynamic"):
                    path.unlink(missing_ok=True)
            yield

    def reserve(self) -> None:
        """Takes all that the files need, so that none of their pages is missing later.

        Raises `BridgeError` when they do not fit.
        """
        for path in self.shared():
            try:
                file = os.open(path, os.O_RDWR)
            except FileNotFoundError:
                # A connection whose other side has gone.
                continue
            try:
                size = os.fstat(file).st_size
                if size:
                    os.posix_fallocate(file, 0, size)
            except OSError as error:
                raise BridgeError(f"{path} cannot be reserved: {error}; {_remedy()}") from error
            finally:
                os.close(file)

    def remove_leftovers(self) -> None:
        """Removes what iceoryx2 leaves of an instance without nodes.

        That is a counter of 16 bytes in shared memory, and empty folders. A folder that is in
        use is not empty, and stays.
        """
        try:
            with self._lock():
                self._remove_leftovers()
        except BridgeError:
            # Without the lock it all stays, for `controller clean`.
            return

    def _remove_leftovers(self) -> None:
        nodes = self.folder / "nodes"
        if nodes.is_dir() and any(nodes.iterdir()):
            return
        for file in SHARED_MEMORY.glob(f"{self.prefix}*.global_mgmt"):
            if file.lstat().st_uid == self.user:
                file.unlink(missing_ok=True)
        for folder in (nodes, self.folder / "services", self.folder):
            try:
                folder.rmdir()
            except OSError:
                # In use, or gone already.
                continue

    @contextmanager
    def _lock(self) -> Iterator[None]:
        """Held while an instance is opened, closed or cleaned: one at a time of each user."""
        file = self._claim_folder(self._user_folder)
        try:
            for _ in range(_LOCK_TRIES_MAX):
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    time.sleep(_LOCK_PAUSE_S)
            else:
                raise BridgeError(
                    f"`{self._user_folder}` is locked by another process of this user, which does "
                    f"not let go: see which by `fuser {self._user_folder}`"
                )
            yield
        finally:
            os.close(file)

    def _claim_folder(self, path: Path) -> int:
        """Makes a folder of this user's own, or checks that it is one; opened."""
        try:
            path.mkdir(mode=0o700, exist_ok=True)
        except FileExistsError:
            # A file, or a link to nothing: looked at below.
            pass
        except OSError as error:
            raise BridgeError(f"{error}; check that /tmp is writable by this user") from error
        self._check(path)
        try:
            return os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except OSError as error:
            raise BridgeError(
                f"`{path}` is a link or a file in place of a folder: remove it"
            ) from error

    def _check(self, path: Path) -> int:
        """Permissions of a file that is this user's and nobody else can write; 0 of none."""
        try:
            about = path.lstat()
        except FileNotFoundError:
            return 0
        if about.st_uid != self.user:
            raise BridgeError(
                f"`{path}` belongs to user {about.st_uid}, not to user {self.user} who runs this: "
                "let its owner or root remove it, or use another instance"
            )
        mode = about.st_mode & 0o777
        if mode & 0o022 and not stat.S_ISLNK(about.st_mode):
            raise BridgeError(
                f"`{path}` can be written by others (mode {mode:03o}): see what lies there, then "
                f"`chmod -R go-w {path}` or remove it"
            )
        return mode


def check_memory() -> None:
    """Raises `BridgeError` where shared memory is missing, full or not writable."""
    try:
        system = os.statvfs(SHARED_MEMORY)
    except OSError as error:
        raise BridgeError(
            f"{SHARED_MEMORY} is missing ({error}): "
            f"`mount -t tmpfs -o mode=1777 tmpfs {SHARED_MEMORY}`"
        ) from error
    if not os.access(SHARED_MEMORY, os.W_OK | os.X_OK):
        raise BridgeError(
            f"{SHARED_MEMORY} is not writable by this user: "
            f"`mount -o remount,rw,mode=1777 {SHARED_MEMORY}`"
        )
    # A tmpfs without a limit counts nothing.
    if system.f_files and system.f_ffree < _FILES_MIN:
        raise BridgeError(
            f"{SHARED_MEMORY} has room for {system.f_ffree} files, at least {_FILES_MIN} are "
            f"needed: remove some, or `mount -o remount,nr_inodes=1k {SHARED_MEMORY}`"
        )
    free = system.f_bavail * system.f_frsize
    if system.f_blocks and free < SHARED_MEMORY_MIN_BYTES:
        raise BridgeError(
            f"{SHARED_MEMORY} has {free} bytes free, at least {SHARED_MEMORY_MIN_BYTES} are "
            f"needed: {_remedy()}"
        )


def _remedy() -> str:
    return (
        "remove what fills it (`controller clean` removes what killed processes left), or "
        f"`mount -o remount,size=64M {SHARED_MEMORY}`"
    )
