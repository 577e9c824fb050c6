"""Files written whole, names that come out of files, and what is printed for whoever reads it.

The Rust programs have the same in `controller/files`.
"""

from __future__ import annotations

import io
import os
import stat
import sys
import tempfile
import unicodedata
from pathlib import Path

from sim_bridge.errors import BridgeError

NAME_BYTES_MAX = 100
NAME = (
    f"a name of 1 to {NAME_BYTES_MAX} bytes without `/`, `\\`, control characters, a dot or minus "
    "sign first or white space at its ends"
)
"""What `is_name` expects."""

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
}


def write(file: Path, content: str | bytes, *, force: bool) -> None:
    """Writes a file: it is there whole afterwards, or what was there before is.

    Only files are replaced, and only with `force`; of a symbolic link it is the target. Raises
    `BridgeError` with the reason.
    """
    check(file, force=force)
    target = Path(os.path.realpath(file))
    data = content.encode() if isinstance(content, str) else content
    try:
        descriptor, draft = tempfile.mkstemp(".partial", f".{target.name[:50]}.", target.parent)
        try:
            with os.fdopen(descriptor, "wb") as opened:
                opened.write(data)
                opened.flush()
                os.fchmod(descriptor, _mode(target))
                os.fsync(descriptor)
            if force:
                os.replace(draft, target)
            else:
                # Unlike a renaming it fails when a file has come in the meantime.
                os.link(draft, target)
        finally:
            Path(draft).unlink(missing_ok=True)
        folder = os.open(target.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except FileExistsError as error:
        raise _exists(file) from error
    except OSError as error:
        raise _refused(file, error) from error


def check(file: Path, *, force: bool) -> None:
    """Raises `BridgeError` when `write` would not write this file, as far as can be known."""
    try:
        mode = file.stat().st_mode
    except FileNotFoundError:
        return
    except OSError as error:
        raise _refused(file, error) from error
    if not stat.S_ISREG(mode):
        kind = _KINDS.get(stat.S_IFMT(mode), "a device")
        raise BridgeError(
            f"{file}: cannot be written: it is {kind}; name a file that is there, or a new one"
        )
    if not force:
        raise _exists(file)


def make_folder(folder: Path) -> None:
    """Makes a folder where it is missing; raises `BridgeError` when it cannot be written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise _refused(folder, error) from error


def _mode(target: Path) -> int:
    """Permissions of a file that is there, or of a new one."""
    try:
        return stat.S_IMODE(target.stat().st_mode)
    except FileNotFoundError:
        umask = os.umask(0)
        os.umask(umask)
        return 0o666 & ~umask


def _exists(file: Path) -> BridgeError:
    return BridgeError(
        f"{file}: is there already and stays as it is: name another place, or give --force to "
        "replace it"
    )


def _refused(file: Path, error: OSError) -> BridgeError:
    return BridgeError(f"{file}: cannot be written: {error.strerror}")


def is_name(text: object) -> bool:
    """Whether it is fit for a file name, a line on a terminal and a page."""
    return (
        isinstance(text, str)
        and 1 <= len(text.encode(errors="surrogatepass")) <= NAME_BYTES_MAX
        and text[0] not in ".-"
        and text.strip() == text
        and not any(c in "/\\" or _is_control(c) for c in text)
    )


def printable(text: str) -> str:
    """The text with its control characters escaped, so that it moves no cursor; line ends stay."""
    return "".join(
        c.encode("unicode_escape").decode() if _is_control(c) and c != "\n" else c for c in text
    )


def _is_control(c: str) -> bool:
    # Controls, formats such as the direction of writing, halves of pairs, and separators.
    return unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp")


class _Stream(io.FileIO):
    """A standard stream, whether somebody reads it or not.

    A reader that has gone away, as in `sim-bridge … | head`, is no reason to fail; what else goes
    wrong is reported when it first happens, and kept.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self.failed = False

    def write(self, data: bytes) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            pass
        except OSError as error:
            if not self.failed and self.fileno() != 2:
                print(
                    f"sim-bridge: standard output cannot be written: {error.strerror}",
                    file=sys.stderr,
                )
            self.failed = True
        return len(data)


class StandardStreams:
    """Standard output and standard error for as long as the `with` block lasts."""

    def __enter__(self) -> StandardStreams:
        self._before = sys.stdout, sys.stderr
        self._streams = _Stream(1), _Stream(2)
        sys.stdout, sys.stderr = (
            io.TextIOWrapper(
                io.BufferedWriter(stream),
                encoding=before.encoding,
                errors="backslashreplace",
                line_buffering=stream.isatty() or stream.fileno() == 2,
            )
            for stream, before in zip(self._streams, self._before)
        )
        return self

    def __exit__(self, *_: object) -> None:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        sys.stdout, sys.stderr = self._before

    @property
    def lost(self) -> bool:
        """Whether something else than a missing reader kept a text from standard output."""
        sys.stdout.flush()
        return self._streams[0].failed
